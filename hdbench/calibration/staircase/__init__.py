"""Raw readings under changing weights: plateaus found, glitches left out, loads made of them."""
