"""What was found, as a person and a program read it: result, extended model, tables, pictures."""
