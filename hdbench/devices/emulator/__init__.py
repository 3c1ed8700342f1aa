"""Emulated devices: a simulated bench behind each kind of DAQ, on its own wire."""
