"""The record as the diagnosis sees it: what was measured, and what of it is fit for use."""
