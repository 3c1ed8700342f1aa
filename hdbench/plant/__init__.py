"""Physics of the simulated bench: what a real one has beyond its model."""
