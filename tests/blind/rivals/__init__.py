"""Rivals of the diagnosis: an oracle, and simpler methods."""
