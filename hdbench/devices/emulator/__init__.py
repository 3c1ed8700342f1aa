"""Emulated bench: the plant, and the node that serves it over Modbus TCP."""
