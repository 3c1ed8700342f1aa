"""Torque of weights on an arm: model, corrections, uncertainty."""
