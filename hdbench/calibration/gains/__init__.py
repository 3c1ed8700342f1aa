"""Gains of experiments: scatter within and between positions, differences, outliers."""
