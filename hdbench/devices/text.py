"""Text that a device tells, fit for a terminal."""

from __future__ import annotations

import unicodedata

__all__ = ["clean_text"]


def clean_text(raw: bytes) -> str:
    """Return device text without control, format and undecodable characters."""
    text = raw.split(b"\0", 1)[0].decode("utf-8", errors="replace")
    printable = (c for c in text if unicodedata.category(c)[0] != "C")
    return "".join(printable).replace("\N{REPLACEMENT CHARACTER}", "").strip()
