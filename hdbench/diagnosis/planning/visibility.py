"""Whether a motion shows an effect, and how large it has to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.planning.imitation import Imitator, Target, make_target
from hdbench.diagnosis.planning.lines import LineSpectra
from hdbench.diagnosis.planning.signatures import Effect, fitted_shape, line_key
from hdbench.diagnosis.planning.sketch import Sketch
from hdbench.model import BenchModel, Cause, Motion, shape_bounds, with_signal
from hdbench.records.trace import FloatArray

__all__ = ["HELD", "SAME_SPACE", "Visibility", "line_tops", "look_at", "with_simulated"]

# contract: names whose effect spans the same space
SAME_SPACE = 0.01
# probability of any finding on a record without effects, and power, as in the diagnosis
_ALPHA = 0.01
_POWER = 1.2815515655446004
# independent trials along each shape that is no place on an axis
_TRIALS = 10.0
# why an effect is not seen that the baseline holds already
HELD = "the baseline imitates it"


@dataclass(frozen=True, slots=True)
class Visibility:
    """Whether a motion shows an effect.

    Parameters
    ----------
    name : str
        Cause.
    reason : str
        Why it cannot be seen; empty where it can.
    baseline_share : float
        Share of the effect that the baseline imitates, in [0, 1].
    std_nm : float or None
        Cramer-Rao bound of its peak torque, N m; None where it cannot be seen.
    detectable_nm : float or None
        Peak torque that is found with 90 %, N m.
    """

    name: str
    reason: str
    baseline_share: float
    std_nm: float | None
    detectable_nm: float | None

    @property
    def visible(self) -> bool:
        """Whether the motion shows it."""
        return not self.reason


def line_tops(effects: Sequence[Effect], motion: Motion) -> dict[str, float]:
    """Return the highest order and frequency that any of the effects can have.

    Parameters
    ----------
    effects : sequence of Effect
        Effects.
    motion : Motion
        Motion that bounds their shapes.

    Returns
    -------
    dict
        ``order`` and ``frequency_hz``, at least 1 each.
    """
    tops = {"order": 1.0, "frequency_hz": 1.0}
    for effect in effects:
        key = line_key(effect.cause)
        if key is not None:
            bands = shape_bounds(effect.cause, motion)[key]
            # a cause with several pairs has as many harmonics
            harmonics = max(1, len(effect.cause.linear) // 2)
            tops[key] = max(tops[key], *(harmonics * high for _, high in bands), 1.0)
    return tops


def with_simulated(motion: Motion, model: BenchModel) -> Motion:
    """Return the motion with the torque of a model, for causes that act on the whole signal.

    Parameters
    ----------
    motion : Motion
        Motion.
    model : BenchModel
        Model.

    Returns
    -------
    Motion
        The motion itself where it has a simulated torque.
    """
    if motion.simulated_nm is not None:
        return motion
    return with_signal(motion, model.torque_nm)


def look_at(
    effect: Effect, sketch: Sketch, spectra: LineSpectra, names: int
) -> tuple[Visibility, tuple[Target, Imitator] | None]:
    """Return whether a motion shows an effect, and what compares it with others.

    Parameters
    ----------
    effect : Effect
        Effect.
    sketch : Sketch
        Sketch of the motion.
    spectra : LineSpectra
        Spectra on that sketch.
    names : int
        How many effects are looked for at once.

    Returns
    -------
    visibility : Visibility
        Whether it is seen and how large it has to be.
    compared : tuple of (Target, Imitator) or None
        None where it is not seen.
    """
    cause = effect.cause
    if not cause.additive:
        reason = "it is no torque but a fault of samples, noise or angle: looks of its own find it"
        return Visibility(cause.name, reason, 1.0, None, None), None
    reason = cause.applicable(sketch.motion) or ""
    missing = [c for c in cause.channels if getattr(sketch.motion, c) is None]
    if missing and not reason:
        reason = f"the record has no {', '.join(missing)}"
    shape = fitted_shape(cause, effect.shape, sketch.motion, sketch.few.time_s)
    if shape is None:
        reason = reason or "the record leaves nothing of its domain"
    if reason or shape is None:
        return Visibility(cause.name, reason, 1.0, None, None), None
    effect = replace(effect, shape=shape)
    remembers = sketch.remembers(cause, shape)
    columns = sketch.columns(cause, shape, remembers=remembers)
    target = make_target(effect, sketch, columns)
    if not target.share > SAME_SPACE:
        why = HELD if target.energy > 0.0 else "it gives no torque here"
        return Visibility(cause.name, why, 1.0 - target.share, None, None), None
    coefficient = _bound(columns, sketch)
    std_nm = coefficient * sketch.peak(cause, shape)
    d = _needed(cause, sketch, float(names))
    entry = Visibility(cause.name, "", 1.0 - target.share, std_nm, d * std_nm)
    if _beyond_domain(cause, d * coefficient):
        why = (
            f"only more than {d * std_nm:.2g} N m of it would show, which its domain does not hold"
        )
        return Visibility(cause.name, why, 1.0 - target.share, std_nm, d * std_nm), None
    return entry, (target, Imitator(cause, sketch, remembers, spectra))


def _bound(columns: FloatArray, sketch: Sketch) -> float:
    """Return the Cramer-Rao bound of an effect's coefficients, their root mean square.

    The baseline's parameters are free. Times the largest row of the columns, which for a cosine and
    a sine is 1, it is that of the peak torque.
    """
    left = sketch.project(columns)
    inverse = np.linalg.pinv(left.T @ left, hermitian=True)
    return float(np.sqrt(np.mean(np.diag(inverse))))


def _needed(cause: Cause, sketch: Sketch, names: float) -> float:
    """Return how many standard deviations are found with 90 %: root of the threshold plus 1.28."""
    from scipy.special import chdtri

    trials = names
    key = line_key(cause)
    motion = sketch.motion
    if key is not None:
        length = (
            np.ptp(motion.angle_rad) / (2.0 * np.pi) if key == "order" else np.ptp(motion.time_s)
        )
        width = sum(high - low for low, high in shape_bounds(cause, motion)[key])
        trials *= max(1.0, 2.0 * float(length) * width)
    else:
        trials *= _TRIALS ** len(cause.shape)
    threshold = float(chdtri(max(1, len(cause.linear)), _ALPHA / trials))
    return float(np.sqrt(threshold)) + _POWER


def _beyond_domain(cause: Cause, coefficient: float) -> bool:
    """Return whether the smallest coefficient that would show is outside of its domain."""
    widest = max((max(abs(p.lower), abs(p.upper)) for p in cause.linear), default=np.inf)
    return not coefficient <= widest
