"""A calibration for a person at the bench: planned, asked for, guarded, journaled, resumed."""
