"""Noise of a filter model by maximum likelihood of its innovations."""
