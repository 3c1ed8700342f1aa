"""Discovery: one model of a dynamic record, and the search for what it lacks."""
