"""The commands: each parses its words, calls the library, and shows the answer."""
