"""Whether a value that was read is the one that the profile names."""

from __future__ import annotations

import math

from hdbench.profile.acquiring_modbus import ModbusIdentify

__all__ = ["fits", "needed"]

# 32-bit floats carry a decimal number to 6e-8 of itself
_ROUNDING = 1e-6


def fits(rule: ModbusIdentify, found: float | int) -> bool:
    """Return whether a value keeps a rule."""
    if not math.isfinite(found):
        return False
    value = float(int(found) & rule.mask) if rule.mask is not None else float(found)
    near = rule.equals is None or abs(value - rule.equals) <= _ROUNDING * abs(rule.equals)
    low = -math.inf if rule.low is None else rule.low
    high = math.inf if rule.high is None else rule.high
    return near and low <= value <= high


def needed(rule: ModbusIdentify) -> str:
    """Return a rule in words."""
    words = [] if rule.equals is None else [f"{rule.equals:.9g}"]
    if rule.low is not None or rule.high is not None:
        low = "anything" if rule.low is None else f"{rule.low:.9g}"
        high = "anything" if rule.high is None else f"{rule.high:.9g}"
        words.append(f"{low} to {high}")
    masked = "" if rule.mask is None else f" in the bits 0x{rule.mask:X}"
    return " and ".join(words) + masked
