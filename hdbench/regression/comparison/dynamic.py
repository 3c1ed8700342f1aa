"""Two misalignment or ripple results: what is compared, and what decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.records import Quantity
from hdbench.regression.comparison.item import Compared
from hdbench.regression.comparison.moved import Moved
from hdbench.regression.comparison.orderpair import OrderPair
from hdbench.regression.comparison.orders import compare_pattern
from hdbench.regression.comparison.score import Part, compared
from hdbench.regression.comparison.side import Side, number, quantity

__all__ = ["compare_misalignments", "compare_ripples", "gain_words"]


@dataclass(frozen=True, slots=True)
class _Pairing:
    """Both sides and how their numbers are held against each other."""

    a: Side
    b: Side
    confidence: float
    shared: tuple[float, float | None] | None

    def parts(self, first: Quantity, second: Quantity) -> tuple[Part, ...]:
        """Return what one gain in both does to a torque."""
        if self.shared is None:
            return ()
        relative, dof = self.shared
        return (Part(first.value * relative, second.value * relative, dof),)

    def torque(
        self, named: tuple[str, str, str], a: Any, b: Any, *, decides: bool = False, note: str = ""
    ) -> Compared | None:
        """Compare a number that the gain scales; None where one side lacks it."""
        first = quantity(a, f"{self.a.where}: {named[0]}")
        second = quantity(b, f"{self.b.where}: {named[0]}")
        if first is None or second is None:
            return None
        return compared(
            named,
            first,
            second,
            common=self.parts(first, second),
            confidence=self.confidence,
            decides=decides,
            note=note,
        )


def _scale(side: Side) -> Mapping[str, Any]:
    scale = side.result.get("torque_scale")
    return scale if isinstance(scale, Mapping) else {}


def _shared_gain(a: Side, b: Side, independent: bool) -> tuple[float, float | None] | None:
    """Return relative uncertainty and dof of the gain where both results have the same one."""
    first, second = _scale(a), _scale(b)
    gain = first.get("gain_nm_per_v")
    same = all(first.get(key) == second.get(key) for key in ("gain_nm_per_v", "source", "sha256"))
    if independent or not same or not isinstance(gain, Mapping):
        return None
    found = quantity(gain, f"{a.where}: torque_scale.gain_nm_per_v")
    if found is None or found.value == 0.0:
        return None
    return found.std / abs(found.value), found.dof


def gain_words(a: Side, b: Side, *, independent: bool) -> str:
    """Say what was taken of the gains of both."""
    if independent:
        return "gains taken as independent, as asked"
    if _shared_gain(a, b, independent) is not None:
        return f"one gain scaled both ({_scale(a).get('source')}): its error is common to both"
    return f"two gains ({_scale(a).get('source')}; {_scale(b).get('source')}): taken as independent"


def _pairing(a: Side, b: Side, confidence: float, independent: bool) -> _Pairing:
    return _Pairing(a, b, confidence, _shared_gain(a, b, independent))


def _order_pair(pairing: _Pairing, order: float, a: Any, b: Any) -> OrderPair | None:
    """Return one order of both as amplitude and phase, or None where one lacks it."""
    if not (isinstance(a, Mapping) and isinstance(b, Mapping)):
        return None
    sides = ((a, pairing.a.where), (b, pairing.b.where))
    size = [quantity(body.get("amplitude_nm"), f"{where}: amplitude_nm") for body, where in sides]
    phase = [quantity(body.get("phase_rad"), f"{where}: phase_rad") for body, where in sides]
    if size[0] is None or size[1] is None or phase[0] is None or phase[1] is None:
        return None
    common = pairing.parts(size[0], size[1])
    return OrderPair(order, size[0], size[1], phase[0], phase[1], common)


def compare_misalignments(
    a: Side,
    b: Side,
    *,
    confidence: float = 0.95,
    same_origin: bool = False,
    independent: bool = False,
) -> Moved:
    """Compare two misalignment results, as before and after a re-assembly."""
    tests = 2 if same_origin else 1
    pairing = _pairing(a, b, 1.0 - (1.0 - confidence) / tests, independent)
    pair = _order_pair(pairing, 1.0, a.result, b.result)
    pattern = None
    if pair is not None:
        pattern = compare_pattern([pair], same_origin=same_origin, confidence=pairing.confidence)
    found = [
        pairing.torque(
            ("peak_to_peak_nm", "misalignment, peak to peak", "N m"),
            a.result.get("peak_to_peak_nm"),
            b.result.get("peak_to_peak_nm"),
            decides=True,
        )
    ]
    peaks = [(side.result.get("after") or {}).get("peak_to_peak_nm") for side in (a, b)]
    named = ("after.peak_to_peak_nm", "the same, filtered", "N m")
    found.append(pairing.torque(named, *peaks))
    return Moved(tuple(x for x in found if x is not None), pattern)


def _by_order(side: Side) -> dict[float, Mapping[str, Any]]:
    entries = side.result.get("ripple")
    found = {}
    for entry in entries if isinstance(entries, list) else ():
        order = number(entry.get("order")) if isinstance(entry, Mapping) else None
        if order is not None:
            found[order] = entry
    return found


def compare_ripples(
    a: Side,
    b: Side,
    *,
    confidence: float = 0.95,
    same_origin: bool = False,
    independent: bool = False,
) -> Moved:
    """Compare two ripple results: every order's amplitude, and all of them as vectors."""
    first, second = _by_order(a), _by_order(b)
    orders = sorted(first.keys() & second.keys())
    tests = len(orders) + (1 if same_origin or len(orders) > 1 else 0)
    level = 1.0 - (1.0 - confidence) / max(1, tests)
    pairing = _pairing(a, b, level, independent)
    found = [
        pairing.torque(
            (f"ripple[order={order:g}].amplitude_nm", f"ripple order {order:g}, amplitude", "N m"),
            first[order].get("amplitude_nm"),
            second[order].get("amplitude_nm"),
            decides=True,
        )
        for order in orders
    ]
    pairs = [_order_pair(pairing, order, first[order], second[order]) for order in orders]
    pattern = compare_pattern(
        [pair for pair in pairs if pair is not None], same_origin=same_origin, confidence=level
    )
    for key, words in (("measured", "measured torque, rms"), ("filtered", "filtered torque, rms")):
        rms = [number((side.result.get("torque_rms_nm") or {}).get(key)) for side in (a, b)]
        if rms != [None, None]:
            note = "no uncertainty declared"
            name = f"torque_rms_nm.{key}"
            found.append(Compared(name, words, "N m", rms[0], rms[1], note=note))
    lost = [f"order {order:g}" for order in sorted(first.keys() - second.keys())]
    new = [f"order {order:g}" for order in sorted(second.keys() - first.keys())]
    return Moved(tuple(x for x in found if x is not None), pattern, tuple(lost), tuple(new))
