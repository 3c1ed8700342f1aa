"""Faults of the acquisition: hypotheses with evidence from the torque or a second channel."""
