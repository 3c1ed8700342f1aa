"""Sealed truth: what was hidden is committed to before anyone answers."""

import hashlib
import json
from dataclasses import asdict


def _plain(value):
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.item() if hasattr(value, "item") else value


def truth_text(truth):
    """One line of JSON."""
    return json.dumps(_plain(truth), sort_keys=True)


def case_text(case):
    """The case as one line of JSON: with the seed in it, all of the truth follows from it."""
    return truth_text(asdict(case))


def salt_of(case):
    """A salt that nobody guesses without the seed."""
    return hashlib.sha256(f"salt {case.seed} {case.key}".encode()).hexdigest()[:32]


def seal(salt, text):
    """SHA-256 of salt and text, hexadecimal."""
    return hashlib.sha256((salt + text).encode()).hexdigest()
