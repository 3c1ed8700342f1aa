"""One start of a tuning: the model to be tuned, the motion, and a try for each slow torque."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from hdbench.filter.blocks import OscillatorBlock, SlowBlock, SlowKind
from hdbench.filter.channels import Channels
from hdbench.filter.model import FilterModel
from hdbench.filter.tuning.data import Motion, preview
from hdbench.filter.tuning.finish import scaled
from hdbench.filter.tuning.likelihood import score
from hdbench.filter.tuning.limits import refusal
from hdbench.filter.tuning.parameters import Problem, build_problem
from hdbench.filter.tuning.result import CandidateResult
from hdbench.filter.tuning.search import maximise
from hdbench.filter.tuning.settings import TuningSettings
from hdbench.records import FloatArray

__all__ = ["Trial", "kinds_of"]

_AUTO: tuple[SlowKind | None, ...] = (None, "ornstein-uhlenbeck", "resonance")
_WALKS = ("none", "random-walk", "integrated-random-walk")


def kinds_of(settings: TuningSettings) -> tuple[SlowKind | None, ...]:
    """Return the kinds of slow torque that are tried."""
    if settings.slow == "auto":
        return _AUTO
    return (None,) if settings.slow == "none" else (settings.slow,)


@dataclass(frozen=True, slots=True)
class Trial:
    """What every try has in common.

    Parameters
    ----------
    start : FilterModel
        Orders and offset at measurement noise 1, priors relative to it.
    settings : TuningSettings
        What is asked.
    motion : Motion
        The traces' motion.
    noise_nm2 : float
        First guess of the measurement noise, (N m)^2.
    """

    start: FilterModel
    settings: TuningSettings
    motion: Motion
    noise_nm2: float

    @classmethod
    def of(
        cls, base: FilterModel, settings: TuningSettings, motion: Motion, noise_nm2: float
    ) -> Trial:
        """Prepare a model: noise per angle, priors relative, the offset."""
        return cls(_prepared(base, settings, motion, noise_nm2), settings, motion, noise_nm2)

    def problem(self, kind: SlowKind | None) -> Problem:
        """Return what is varied for one kind of slow torque."""
        return build_problem(self.start, kind, self.motion, self.noise_nm2)

    def attempt(self, kind: SlowKind | None, records: Sequence[Channels]) -> CandidateResult:
        """Search the most likely point for one kind of slow torque."""
        problem, part = self.problem(kind), [preview(record) for record in records]

        def value(logs: FloatArray) -> float:
            return score(problem.model(logs), records).log_likelihood

        def value_of_part(logs: FloatArray) -> float:
            return score(problem.model(logs), part).log_likelihood

        most = self.settings.max_evaluations
        best = maximise(problem, value, preview=value_of_part, max_evaluations=most)
        penalty = 0.5 * math.log(self.motion.samples) * len(problem.parameters)
        guarded = self.settings.slow == "auto"
        return CandidateResult(
            kind or "none",
            best.log_likelihood,
            best.log_likelihood - penalty,
            best,
            refusal(problem.model(best.logs), self.motion) if guarded else None,
        )

    def model(
        self, kind: SlowKind | None, logs: FloatArray, records: Sequence[Channels]
    ) -> FilterModel:
        """Return the model of a point in absolute units, without a gate."""
        relative = self.problem(kind).model(logs)
        return scaled(relative, score(relative, records).noise_nm2)


def _prepared(
    base: FilterModel, settings: TuningSettings, motion: Motion, noise_nm2: float
) -> FilterModel:
    """Return the model at measurement noise 1: noise per angle, priors relative, the offset."""
    scale = math.sqrt(noise_nm2)
    blocks = tuple(
        OscillatorBlock(
            block.order,
            block.role,
            block.process_noise,
            "second" if block.frequency_hz > 0.0 else "motor-radian",
            block.frequency_hz,
        )
        for block in base.blocks
    )
    walking = settings.slow in _WALKS
    offset = () if walking else (SlowBlock("random-walk", noise_per_s=_offset_noise(base, motion)),)
    return replace(
        base,
        blocks=blocks,
        slow=offset,
        measurement_noise=1.0,
        order_prior_std_nm=settings.order_prior_std_nm / scale,
        slow_prior_std_nm=settings.slow_prior_std_nm / scale,
        gate_sigma=None,
        tuning=None,
    )


def _offset_noise(base: FilterModel, motion: Motion) -> float:
    r"""Return the wander of the offset per second, relative to the measurement noise.

    A random walk has the density q / w^2, white noise R dt: equal at the slowest block's angular
    frequency w, so that the offset can never hold what turns with the output.
    """
    slowest = min((b.order for b in base.blocks if b.order > 0.0), default=1.0)
    w = slowest * motion.speed_rad_s
    if not w > 0.0:
        w = 2.0 * math.pi / motion.duration_s
    return motion.period_s * w * w
