"""Two emulated devices around one simulated bench."""
