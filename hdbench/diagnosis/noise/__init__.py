"""The noise of a record, and the space in which it is white."""
