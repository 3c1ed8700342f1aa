"""Two misalignment, ripple or diagnosis results: what is compared, and what decides."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.comparison.orders import OrderPair, Pattern, compare_pattern
from hdbench.comparison.score import Compared, SharedPart, Terms, compared
from hdbench.records import Quantity
from hdbench.results import DiagnosisResult, MisalignmentResult, RippleResult
from hdbench.results.dynamic import RippleOrder

_Motion = MisalignmentResult | RippleResult
_Line = MisalignmentResult | RippleOrder


@dataclass(frozen=True, slots=True)
class Moved:
    """What two results of one kind say of each other.

    Parameters
    ----------
    quantities : tuple of Compared
        Numbers of both.
    pattern : Pattern or None
        Their orders as vectors.
    assumption : str
        What was taken as common to both.
    only_a, only_b : tuple of str
        Orders or causes that only one of them has and that would decide.
    """

    quantities: tuple[Compared, ...]
    assumption: str
    pattern: Pattern | None = None
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()


class _Gains:
    """Gains that scaled both torques: whether they are one, and what that does to a torque."""

    def __init__(self, a: _Motion, b: _Motion, terms: Terms, tests: int) -> None:
        scales = a.torque_scale, b.torque_scale
        first, second = (None if x is None else x.source for x in scales)
        keys = [x and (x.gain_nm_per_v, x.source, x.sha256) for x in scales]
        self._shared = None if terms.independent or keys[0] != keys[1] else scales[0]
        if self._shared is not None and self._shared.gain_nm_per_v.value == 0.0:
            self._shared = None
        self.confidence = terms.level(tests)
        self.words = f"two gains ({first}; {second}): taken as independent"
        if terms.independent:
            self.words = "gains taken as independent, as asked"
        elif self._shared is not None:
            self.words = f"one gain scaled both ({first}): its error is common to both"

    def parts(self, first: Quantity, second: Quantity) -> tuple[SharedPart, ...]:
        """Return what one gain in both does to a torque."""
        if self._shared is None:
            return ()
        relative, dof = self._shared.relative_std, self._shared.gain_nm_per_v.dof
        return (SharedPart(first.value * relative, second.value * relative, dof),)

    def compared(
        self, name: str, label: str, a: Quantity, b: Quantity, *, decides: bool = True
    ) -> Compared:
        """Compare a torque."""
        common, named = self.parts(a, b), (name, label, "N m")
        return compared(named, a, b, common=common, confidence=self.confidence, decides=decides)

    def pair(self, order: float, a: _Line, b: _Line) -> OrderPair:
        """Return an order of both."""
        common = self.parts(a.amplitude_nm, b.amplitude_nm)
        return OrderPair(order, a.amplitude_nm, b.amplitude_nm, a.phase_rad, b.phase_rad, common)


def compare_misalignments(a: MisalignmentResult, b: MisalignmentResult, terms: Terms) -> Moved:
    """Compare two misalignment results, as before and after a re-assembly."""
    gains = _Gains(a, b, terms, 2 if terms.same_origin else 1)
    pattern = compare_pattern([gains.pair(1.0, a, b)], terms.same_origin, gains.confidence)
    sizes = (
        ("peak_to_peak_nm", "misalignment, peak to peak", a.peak_to_peak_nm, b.peak_to_peak_nm),
        (
            "after.peak_to_peak_nm",
            "the same, filtered",
            a.after.peak_to_peak_nm,
            b.after.peak_to_peak_nm,
        ),
    )
    found = [gains.compared(*size, decides=size is sizes[0]) for size in sizes]
    return Moved(tuple(found), gains.words, pattern)


def compare_ripples(a: RippleResult, b: RippleResult, terms: Terms) -> Moved:
    """Compare two ripple results: every order's amplitude, and all of them as vectors."""
    first, second = ({entry.order: entry for entry in x.ripple} for x in (a, b))
    orders = sorted(first.keys() & second.keys())
    gains = _Gains(a, b, terms, len(orders) + (terms.same_origin or len(orders) > 1))
    pairs = [gains.pair(order, first[order], second[order]) for order in orders]
    found = [
        gains.compared(
            f"ripple[order={pair.order:g}].amplitude_nm",
            f"ripple order {pair.order:g}, amplitude",
            pair.amplitude_a,
            pair.amplitude_b,
        )
        for pair in pairs
    ]
    for key in ("measured", "filtered"):
        rms = [getattr(x.torque_rms_nm, key) for x in (a, b)]
        if rms != [None, None]:
            name, label = f"torque_rms_nm.{key}", f"{key} torque, rms"
            note = "no uncertainty declared"
            found.append(Compared(name, label, "N m", rms[0], rms[1], note=note))
    pattern = compare_pattern(pairs, terms.same_origin, gains.confidence)
    lost, new = (
        tuple(f"order {order:g}" for order in sorted(has.keys() - lacks.keys()))
        for has, lacks in ((first, second), (second, first))
    )
    return Moved(tuple(found), gains.words, pattern, lost, new)


def compare_diagnoses(a: DiagnosisResult, b: DiagnosisResult, terms: Terms) -> Moved:
    """Compare two diagnoses: causes of one only, and parameters of those of both."""
    first, second = ({cause.name: cause for cause in one.causes} for one in (a, b))
    rows = []
    for name in sorted(first.keys() & second.keys()):
        one, other = first[name].parameters, second[name].parameters
        for key in sorted(one.keys() & other.keys()):
            x, y = one[key], other[key]
            # what has no uncertainty cannot be held against anything
            if x.std is not None and y.std is not None:
                named = (f"{name}.{key}", f"{name}, {key}", "" if x.unit == "1" else x.unit)
                rows.append((named, Quantity(x.value, x.std), Quantity(y.value, y.std)))
    level = terms.level(len(rows))
    found = tuple(compared(named, x, y, confidence=level, decides=True) for named, x, y in rows)
    return Moved(
        found,
        "parameters taken as independent",
        only_a=tuple(sorted(first.keys() - second.keys())),
        only_b=tuple(sorted(second.keys() - first.keys())),
    )
