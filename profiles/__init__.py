"""Benches and plants as TOML files."""
