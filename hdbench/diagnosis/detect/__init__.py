"""Whether anything is left: every look at a residual, and how high noise alone reaches in it."""
