"""Least squares with coloured noise, effective degrees of freedom, spectra in Hz and orders."""
