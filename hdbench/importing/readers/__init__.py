"""One reader for each kind of file: it gives channels with names, and their values by pieces."""
