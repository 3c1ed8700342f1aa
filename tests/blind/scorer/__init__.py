"""Judges answers by the truth that was sealed before they were given."""
