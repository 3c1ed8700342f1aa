"""A fault of the acquisition as a named cause, with its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from hdbench.diagnosis.acquisition.flags import DataFlag
from hdbench.diagnosis.answer.result import NamedCause
from hdbench.diagnosis.confirm.gain import Gain
from hdbench.model import CauseTerm

__all__ = ["Acquired", "Tail", "acquired_cause", "entry", "normal_tail"]


@dataclass(frozen=True, slots=True)
class Acquired:
    """A named fault of the acquisition and what follows from it.

    Parameters
    ----------
    cause : NamedCause
        As the result states it.
    flags : tuple of DataFlag
        Its samples.
    term : CauseTerm or None
        Term of the extended model; None where the samples are masked, not modelled.
    """

    cause: NamedCause
    flags: tuple[DataFlag, ...] = ()
    term: CauseTerm | None = None


@dataclass(frozen=True, slots=True)
class Tail:
    """How far a statistic lies from where it would be without the fault.

    Parameters
    ----------
    nats : float
        Log likelihood ratio less half a log of the samples for each parameter.
    chance : float
        Probability of it anywhere on the record without the fault, in [0, 1].
    """

    nats: float
    chance: float


def normal_tail(sigmas: float, trials: float, parameters: int, samples: int) -> Tail:
    """Return the tail of a normal statistic that was the largest of many.

    Parameters
    ----------
    sigmas : float
        Its size in standard deviations.
    trials : float
        Number of independent chances that it had, at least 1.
    parameters : int
        Parameters that were fitted for it.
    samples : int
        Samples of the record, at least 1.

    Returns
    -------
    Tail
        Two-sided, by the union bound.
    """
    log_chance = float(np.log(2.0 * trials) + log_ndtr(-abs(sigmas)))
    nats = 0.5 * sigmas**2 - 0.5 * parameters * float(np.log(samples))
    return Tail(nats, float(np.exp(min(0.0, log_chance))))


def entry(value: float, std: float | None, unit: str) -> dict[str, float | str | None]:
    """Return a parameter as the contract writes it.

    Parameters
    ----------
    value : float
        Value.
    std : float or None
        Standard uncertainty; None where it is not known.
    unit : str
        Unit of both.

    Returns
    -------
    dict
    """
    return {"value": float(value), "std": None if std is None else float(std), "unit": unit}


def acquired_cause(
    name: str,
    parameters: Mapping[str, Mapping[str, float | str | None]],
    tail: Tail,
    measured: tuple[Gain, float],
    *,
    domain: str,
    group: tuple[str, ...] = (),
    rivals: tuple[str, ...] = (),
    experiment: str | None = None,
) -> NamedCause:
    """Return a fault of the acquisition as the result states it.

    Parameters
    ----------
    name : str
        Name of the contract, section 6.
    parameters : mapping
        As of `NamedCause`.
    tail : Tail
        Evidence and false-alarm probability.
    measured : tuple of (Gain, float)
        Gain, and share of the baseline's residual variance in [0, 1].
    domain : str
        Domain in which it is plainest.
    group, rivals : tuple of str
        Other names that cannot be told from it, and that come near it.
    experiment : str or None
        What would tell them apart; dropped where there is one name.

    Returns
    -------
    NamedCause
    """
    gain, share = measured
    several = bool(group or rivals)
    return NamedCause(
        name,
        (name, *group),
        rivals,
        parameters,
        tail.nats,
        tail.chance,
        gain,
        experiment if several else None,
        share,
        domain,
    )
