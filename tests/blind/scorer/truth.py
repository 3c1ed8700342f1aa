"""Opening sealed truth."""

import hashlib
import json

__all__ = ["open_truth"]


def open_truth(sealed, mark):
    """Return the truth if it is the one that `mark` was made of."""
    if hashlib.sha256((sealed["salt"] + sealed["text"]).encode()).hexdigest() != mark:
        raise ValueError(f"{sealed['key']}: the truth is not the one that was sealed")
    return json.loads(sealed["text"])
