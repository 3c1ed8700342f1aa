"""Commands of hdbench."""
