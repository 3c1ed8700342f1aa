"""Answer of a diagnosis: result, extended model, tables, and names that a record can show."""
