"""Cause: one named effect of the catalogue as a term of the bench model, and its harmonics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a cause.

    Parameters
    ----------
    name : str
        Name with its unit, as in model files.
    unit : str
        Unit, SI; ``1`` where it has none.
    lower, upper : float
        Domain, unit of the parameter.
    description : str
        What it is.
    bands : tuple of (float, float)
        Parts of the domain that are allowed, where it is not one piece; empty for all of it.
    default : float or None
        What a model file that does not give it means; None where every file has to give it.
    """

    name: str
    unit: str
    lower: float
    upper: float
    description: str
    bands: tuple[tuple[float, float], ...] = ()
    default: float | None = None

    def contains(self, value: float) -> bool:
        """Return whether `value` is in the domain; NaN never is.

        Parameters
        ----------
        value : float
            A value, unit of the parameter.

        Returns
        -------
        bool
        """
        bands = self.bands or ((self.lower, self.upper),)
        return any(lower <= value <= upper for lower, upper in bands)


def always(motion: Motion) -> str | None:
    """Return None: the cause needs nothing that a motion can lack."""
    del motion
    return None


def unbounded(motion: Motion) -> Mapping[str, tuple[float, float]]:
    """Return no bounds: every value of the domain can be told on any record."""
    del motion
    return {}


@dataclass(frozen=True, slots=True)
class Cause:
    """One entry of the catalogue: equation, signature and the columns it adds to the torque.

    Parameters
    ----------
    name : str
        Name of the contract, section 6.
    equation : str
        The torque it adds, in the symbols of ``docs/model.md``.
    shape : tuple of Parameter
        Parameters that enter non-linearly.
    linear : tuple of Parameter
        Parameters that multiply the columns, one each.
    locked_to : str
        What it follows: motor, output, clock, velocity, acceleration, load, current or time.
    parity : str
        Sign behaviour under reversal of speed and of load.
    channel : str
        Where it arises: sensor, mechanical, acquisition or kinematic.
    look_alikes : tuple of str
        Names of causes whose torque can look the same.
    experiment : str
        The experiment that tells it from them.
    source : str
        Where the equation comes from.
    columns : callable
        ``columns(motion, shape)`` gives N m per unit of each linear parameter, shape
        (n_samples, n_linear); NaN where the motion is not valid.
    harmonic : bool
        True where `linear` is one (cosine, sine) pair, reported as amplitude and phase too.
    applicable : callable
        ``applicable(motion)`` gives None, or why this record cannot show the cause.
    channels : tuple of str
        Channels that the columns need beside the motion itself, by the names of `Motion`.
    additive : bool
        True where the cause is a torque that `columns` gives; False where it is one of the noise or
        of the acquisition: it then has shape parameters alone and `columns` has no column.
    change_motion : callable or None
        ``change_motion(motion, shape)`` gives the motion that the bench really had, for a fault of
        the angle or of the clock; None for all other causes.
    reach : callable
        ``reach(motion)`` gives for some shape parameters the ends (lower, upper) between which this
        record can tell their values apart; a search stays inside of them.
    whole_signal : bool
        True where `columns` acts on all of the torque in the channel, `Motion.simulated_nm`.
    common : bool
        Whether nearly every drive has it, so that it goes before a rarer name that says as much.
    form_of : str
        Name of a cause of which this one is another form: one torque has one of the two; or empty.
    possible : callable or None
        ``possible(motion, shape)`` gives the directions of the linear parameters whose sums with
        weights of one sign can be, as columns; None where every value in the domains can be.
    definition : mapping or None
        The declaration that a cause of a user's own was read from, JSON-able, so that a model file
        can carry it; None for all others.
    """

    name: str
    equation: str
    shape: tuple[Parameter, ...]
    linear: tuple[Parameter, ...]
    locked_to: str
    parity: str
    channel: str
    look_alikes: tuple[str, ...]
    experiment: str
    source: str
    columns: Callable[[Motion, Mapping[str, float]], FloatArray]
    harmonic: bool
    applicable: Callable[[Motion], str | None] = always
    channels: tuple[str, ...] = ()
    additive: bool = True
    change_motion: Callable[[Motion, Mapping[str, float]], Motion] | None = None
    reach: Callable[[Motion], Mapping[str, tuple[float, float]]] = unbounded
    whole_signal: bool = False
    common: bool = False
    form_of: str = ""
    possible: Callable[[Motion, Mapping[str, float]], FloatArray] | None = None
    definition: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class CauseTerm:
    """One cause with numbers: a term of a bench model.

    Parameters
    ----------
    name : str
        Name of the cause.
    shape : mapping of str to float
        Value of each shape parameter.
    linear : tuple of float
        Value of each linear parameter, in the order of the cause.
    covariance : tuple of tuple of float, or None
        Covariance of the linear, then the shape parameters; None where it is not known.
    """

    name: str
    shape: Mapping[str, float]
    linear: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...] | None = None


def is_harmonic(linear: tuple[Parameter, ...]) -> bool:
    """Return whether parameters are one cosine and its sine."""
    return [parameter.name for parameter in linear] == ["cosine_nm", "sine_nm"]


def shape_bounds(cause: Cause, motion: Motion) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return where each shape parameter can lie on this record.

    Parameters
    ----------
    cause : Cause
        A cause.
    motion : Motion
        The motion of the record.

    Returns
    -------
    dict
        Name of each shape parameter to its bands (lower, upper), its own domain cut to what the
        record can show: times inside the record, frequencies up to half the sampling rate, and
        what the cause itself says (`Cause.reach`). Empty bands where nothing is left.
    """
    first, last = float(motion.time_s[0]), float(motion.time_s[-1])
    span = last - first
    period = float(np.median(np.diff(motion.time_s))) if len(motion.time_s) > 1 else math.inf
    by_unit = {"Hz": (1.0 / span if span > 0.0 else math.inf, 0.5 / period)}
    by_name = {"step_time_s": (first, last), **cause.reach(motion)}
    result = {}
    for parameter in cause.shape:
        anywhere = by_unit.get(parameter.unit, (-math.inf, math.inf))
        low, high = by_name.get(parameter.name, anywhere)
        bands = parameter.bands or ((parameter.lower, parameter.upper),)
        cut = ((max(a, low), min(b, high)) for a, b in bands)
        result[parameter.name] = tuple((a, b) for a, b in cut if a < b)
    return result


@dataclass(frozen=True, slots=True)
class Quadratures:
    """Names of a (cosine, sine) pair of linear parameters and of what it is stated as."""

    cosine: str
    sine: str
    amplitude: str
    phase: str
    unit: str


def quadratures(cause: Cause) -> tuple[Quadratures, ...]:
    """Return the (cosine, sine) pairs among the linear parameters."""
    units = {parameter.name: parameter.unit for parameter in cause.linear}
    pairs = []
    for name, unit in units.items():
        rest = name.removeprefix("cosine")
        if rest == name or f"sine{rest}" not in units:
            continue
        phase = f"phase{rest.rpartition('_')[0]}_rad"
        pairs.append(Quadratures(name, f"sine{rest}", f"amplitude{rest}", phase, unit))
    return tuple(pairs)


def amplitude_phase(
    cosine: float, sine: float, covariance: FloatArray | None = None
) -> tuple[float, float, float | None, float | None]:
    r"""Return amplitude and phase of ``cosine cos(x) + sine sin(x) = A cos(x + phase)``.

    Parameters
    ----------
    cosine, sine : float
        Coefficients, one unit.
    covariance : ndarray, shape (2, 2), or None
        Their covariance.

    Returns
    -------
    amplitude : float
        :math:`A = \sqrt{c^2 + s^2}`, at least 0.
    phase : float
        :math:`\mathrm{atan2}(-s, c)`, rad, in (-pi, pi]; 0 where the amplitude is 0.
    amplitude_std, phase_std : float or None
        Standard uncertainties by linear propagation; None without covariance or at amplitude 0.
    """
    amplitude = math.hypot(cosine, sine)
    phase = math.atan2(-sine, cosine) if amplitude > 0.0 else 0.0
    if covariance is None or amplitude == 0.0:
        return amplitude, phase, None, None
    along = np.array([cosine, sine]) / amplitude
    across = np.array([sine, -cosine]) / amplitude**2
    return (
        amplitude,
        phase,
        standard_uncertainty(float(along @ covariance @ along)),
        standard_uncertainty(float(across @ covariance @ across)),
    )


def standard_uncertainty(variance: float) -> float | None:
    """Return the root of a variance."""
    return math.sqrt(variance) if 0.0 <= variance < math.inf else None
