"""What the simulation of misplaced rosettes hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from hdbench.gauges.layout import cancellation
from hdbench.gauges.misplacement import GaugedBench
from hdbench.gauges.quantiles import Quantile
from hdbench.gauges.tolerance import Tolerance

__all__ = ["ErrorTable", "OneOff", "Scatter"]


@dataclass(frozen=True, slots=True)
class OneOff:
    """One rosette at the edge of one tolerance, all else in place.

    Parameters
    ----------
    rosette : int
        Its number; 0 for all of them on a film off centre.
    kind : str
        ``radial``, ``circumferential``, ``angular`` or ``off-centre``.
    effects : mapping of str to float
        What that does; keys of `Effects`.
    closed_form_2_nm : float or None
        Ripple at order 2 by the closed form, for a circumferential error.
    """

    rosette: int
    kind: str
    effects: Mapping[str, float]
    closed_form_2_nm: float | None


@dataclass(frozen=True, slots=True)
class Scatter:
    """All rosettes off by chance.

    Parameters
    ----------
    kind : str
        Which error; ``all`` for the three together.
    effects : mapping of str to tuple of Quantile
        Quantiles of the size of each effect (without its sign); keys of `Effects`.
    """

    kind: str
    effects: Mapping[str, tuple[Quantile, ...]]


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """What placement does to the torque shown.

    Parameters
    ----------
    bench : GaugedBench
        Flexspline, gauges, sensor.
    tolerance : Tolerance
        How far rosettes may be off.
    draws, seed : int
        Size and seed of the simulation.
    in_place : mapping of str to float
        Effects that stay with every rosette in place.
    one_off : tuple of OneOff
        Every rosette and kind in turn.
    scatter : tuple of Scatter
        Each kind alone, then all.
    """

    bench: GaugedBench
    tolerance: Tolerance
    draws: int
    seed: int
    in_place: Mapping[str, float]
    one_off: tuple[OneOff, ...]
    scatter: tuple[Scatter, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the table as ``--json`` prints it."""
        bench = self.bench
        return {
            "layout": {
                "name": bench.layout.name,
                "words": bench.layout.words,
                "rosettes": [asdict(rosette) for rosette in bench.layout.rosettes],
                **asdict(bench.geometry),
            },
            "strain": asdict(bench.field),
            "sensor": bench.sensor.model_dump(),
            "uncancelled_nm": [
                {
                    "order": wave.order,
                    "amplitude_nm": bench.uncancelled_nm(wave),
                    "left_by_layout": cancellation(bench.layout, wave.order),
                }
                for wave in bench.field.waves
            ],
            "tolerance": asdict(self.tolerance),
            "draws": self.draws,
            "seed": self.seed,
            "in_place": dict(self.in_place),
            "one_off": [asdict(row) for row in self.one_off],
            "scatter": [asdict(row) for row in self.scatter],
        }
