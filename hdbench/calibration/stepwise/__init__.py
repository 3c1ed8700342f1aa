"""Evaluation step by step, in the manner of EURAMET cg-14."""
