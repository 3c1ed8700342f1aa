"""Lines that take their time or spoil what they carry, for tests and campaigns."""
