"""Questions to the person at the bench."""
