"""A bench of its own for blind tests: it hides effects, and shares no code with the product."""
