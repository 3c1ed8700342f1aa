"""The guard: a small process of its own that stops the motor when the session cannot."""
