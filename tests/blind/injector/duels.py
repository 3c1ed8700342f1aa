"""Pairs that look alike on a poor record and differ on a good one."""

from .pieces import hold, locked, swing
from .records import LET_GO

__all__ = ["DUELS", "duel_pieces"]

# pair: (one, other, poor record, size on it, shape parameters that make them look alike on it);
# the good record is the compact protocol
DUELS = {
    "unbalance-eccentricity": (
        "motor-unbalance", "wave-generator-eccentricity", "one-speed", "d15", {}),
    "tone-harmonic": ("structural-tone", "ripple-harmonic", "one-speed", "d15",
                      {"structural-tone": ("frequency_hz", 41.3),
                       "ripple-harmonic": ("order", 3.0)}),
    "creep-warmup": ("creep", "warm-up", "hanging", "d15",
                     {"creep": ("constant_s", 9.0), "warm-up": ("constant_s", 9.0)}),
    "coulomb-step": ("coulomb-friction", "zero-step", "one-reversal", "d15",
                     {"zero-step": ("at_s", 20.04)}),
    "drift-warmup": ("zero-drift", "warm-up", "brief", "d15", {"warm-up": ("constant_s", 100.0)}),
    "gain-position": ("gain-error", "position-dependent-gain", "one-angle", "d15", {}),
    "cubic-saturation": ("cubic-nonlinearity", "saturation", "one-angle", "d10", {}),
    "coulomb-viscous": ("coulomb-friction", "viscous-friction", "two-speeds", "d15", {}),
    "gain-inertia": ("gain-error", "inertia-error", "free", "d10", {}),
    "load-gain-ripple": ("load-dependent-ripple", "gain-ripple", "one-sign", "d15", {}),
    "coulomb-load": ("coulomb-friction", "load-dependent-friction", "one-load", "d15", {}),
    "gain-asymmetry": ("gain-error", "direction-asymmetry", "one-sign", "d15", {}),
}  # fmt: skip


def duel_pieces(record, rng):
    """Return the pieces of a poor record."""
    speed = float(rng.uniform(60.0, 120.0))
    swings = [swing(20.0, 4.0, 6.0), hold(0.0, 2.0), swing(25.0, 2.5, 6.0), hold(0.0, 2.0)]
    if record == "one-speed":
        return [hold(speed, 40.0)]
    if record == "hanging":
        return [hold(0.0, 1.0, 25.0), hold(0.0, 20.0, 25.0), hold(speed, 14.0, 25.0)]
    if record == "brief":
        return [hold(0.0, 4.0), hold(speed, 18.0), hold(0.0, 4.0), hold(-speed, 14.0)]
    if record == "one-reversal":
        return [hold(speed, 20.0), hold(-speed, 20.0)]
    if record == "two-speeds":
        return [hold(sign * speed, 12.0) for sign in (1.0, -1.0, 1.0, -1.0)]
    if record == "free":
        return [*swings, hold(speed, 12.0), *swings]
    if record == "one-angle":
        presses = [locked(20.0, 0.5, 10.0, "sine"), locked(20.0, 0.5, 10.0, "triangle")]
        turn = [hold(0.0, 2.0), hold(speed, 12.0), hold(0.0, 1.0)]
        return [*turn, *presses, LET_GO, hold(0.0, 2.0)]
    load = {"one-sign": (12.0, 25.0), "one-load": (25.0, 25.0)}[record]
    out = [hold(0.0, 3.0)] if record == "one-sign" else [hold(0.0, 0.5, load[0])]
    for value in load:
        out += [hold(speed, 12.0, value), hold(-speed, 12.0, value)]
    return out
