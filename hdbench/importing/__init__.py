"""Bring logs of other programs into traces and loads."""
