"""An emulated DATAQ instrument on a pseudo-terminal."""
