"""Live view of a run on the terminal."""
