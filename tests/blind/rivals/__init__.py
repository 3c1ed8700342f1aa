"""What the diagnosis is held against: an oracle, and simpler methods."""
