"""Which name what is left deserves, which names cannot be told apart, and what has none."""
