"""Two misalignment or ripple results: what is compared, and what decides."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.comparison.orders import OrderPair, Pattern, compare_pattern
from hdbench.comparison.score import Compared, SharedPart, compared
from hdbench.records import Quantity
from hdbench.results import MisalignmentResult, RippleResult

_Motion = MisalignmentResult | RippleResult


@dataclass(frozen=True, slots=True)
class Moved:
    """What two results of one kind say of each other.

    Parameters
    ----------
    quantities : tuple of Compared
        Numbers of both.
    pattern : Pattern or None
        Their orders as vectors.
    only_a, only_b : tuple of str
        Orders or causes that only one of them has and that would decide.
    """

    quantities: tuple[Compared, ...]
    pattern: Pattern | None = None
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Pairing:
    """How two torques are held against each other: confidence, and one gain of both."""

    confidence: float
    shared: tuple[float, float | None] | None

    def parts(self, first: Quantity, second: Quantity) -> tuple[SharedPart, ...]:
        """Return what one gain in both does to a torque."""
        if self.shared is None:
            return ()
        relative, dof = self.shared
        return (SharedPart(first.value * relative, second.value * relative, dof),)

    def torque(
        self, name: str, label: str, a: Quantity, b: Quantity, *, decides: bool = False
    ) -> Compared:
        """Compare a number that the gain scales."""
        return compared(
            (name, label, "N m"),
            a,
            b,
            common=self.parts(a, b),
            confidence=self.confidence,
            decides=decides,
        )


def _shared_gain(a: _Motion, b: _Motion, independent: bool) -> tuple[float, float | None] | None:
    """Return relative uncertainty and dof of the gain where both results have the same one."""
    first, second = a.torque_scale, b.torque_scale
    if independent or first is None or second is None:
        return None
    keys = [(x.gain_nm_per_v, x.source, x.sha256) for x in (first, second)]
    if keys[0] != keys[1] or first.gain_nm_per_v.value == 0.0:
        return None
    return first.relative_std, first.gain_nm_per_v.dof


def gain_words(a: _Motion, b: _Motion, *, independent: bool) -> str:
    """Say what was taken of the gains of both."""
    if independent:
        return "gains taken as independent, as asked"
    first, second = (None if x.torque_scale is None else x.torque_scale.source for x in (a, b))
    if _shared_gain(a, b, independent) is not None:
        return f"one gain scaled both ({first}): its error is common to both"
    return f"two gains ({first}; {second}): taken as independent"


def compare_misalignments(
    a: MisalignmentResult,
    b: MisalignmentResult,
    *,
    confidence: float,
    same_origin: bool,
    independent: bool,
) -> Moved:
    """Compare two misalignment results, as before and after a re-assembly."""
    level = 1.0 - (1.0 - confidence) / (2 if same_origin else 1)
    pairing = _Pairing(level, _shared_gain(a, b, independent))
    pair = OrderPair(
        1.0,
        a.amplitude_nm,
        b.amplitude_nm,
        a.phase_rad,
        b.phase_rad,
        pairing.parts(a.amplitude_nm, b.amplitude_nm),
    )
    pattern = compare_pattern([pair], same_origin=same_origin, confidence=level)
    peak = pairing.torque(
        "peak_to_peak_nm",
        "misalignment, peak to peak",
        a.peak_to_peak_nm,
        b.peak_to_peak_nm,
        decides=True,
    )
    filtered = pairing.torque(
        "after.peak_to_peak_nm",
        "the same, filtered",
        a.after.peak_to_peak_nm,
        b.after.peak_to_peak_nm,
    )
    return Moved((peak, filtered), pattern)


def compare_ripples(
    a: RippleResult,
    b: RippleResult,
    *,
    confidence: float,
    same_origin: bool,
    independent: bool,
) -> Moved:
    """Compare two ripple results: every order's amplitude, and all of them as vectors."""
    first, second = ({entry.order: entry for entry in x.ripple} for x in (a, b))
    orders = sorted(first.keys() & second.keys())
    tests = len(orders) + (1 if same_origin or len(orders) > 1 else 0)
    level = 1.0 - (1.0 - confidence) / max(1, tests)
    pairing = _Pairing(level, _shared_gain(a, b, independent))
    found, pairs = [], []
    for order in orders:
        x, y = first[order], second[order]
        name, label = f"ripple[order={order:g}].amplitude_nm", f"ripple order {order:g}, amplitude"
        found.append(pairing.torque(name, label, x.amplitude_nm, y.amplitude_nm, decides=True))
        common = pairing.parts(x.amplitude_nm, y.amplitude_nm)
        pairs.append(
            OrderPair(order, x.amplitude_nm, y.amplitude_nm, x.phase_rad, y.phase_rad, common)
        )
    pattern = compare_pattern(pairs, same_origin=same_origin, confidence=level)
    for key in ("measured", "filtered"):
        rms = [getattr(x.torque_rms_nm, key) for x in (a, b)]
        if rms != [None, None]:
            name, label = f"torque_rms_nm.{key}", f"{key} torque, rms"
            note = "no uncertainty declared"
            found.append(Compared(name, label, "N m", rms[0], rms[1], note=note))
    lost = [f"order {order:g}" for order in sorted(first.keys() - second.keys())]
    new = [f"order {order:g}" for order in sorted(second.keys() - first.keys())]
    return Moved(tuple(found), pattern, tuple(lost), tuple(new))
