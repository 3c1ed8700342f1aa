"""Causes fitted to what was measured, together with the baseline and in coloured noise."""
