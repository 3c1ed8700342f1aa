"""Causes as plain data, for ``hdbench diagnose --list-causes --json``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hdbench.model.cause import catalogue
from hdbench.model.causes import CAUSE_GROUPS
from hdbench.model.definition import Cause, Parameter

__all__ = ["describe_cause", "describe_causes"]

# group of causes that are no names of the contract
_OWN = "user's own"


def describe_cause(cause: Cause) -> dict[str, Any]:
    """Return a cause as plain data.

    Parameters
    ----------
    cause : Cause
        A cause.

    Returns
    -------
    dict
        ``name``, ``group`` of the contract, ``equation``, ``parameters`` (name, kind ``shape`` or
        ``linear``, unit, domain as ``lower``, ``upper`` and ``bands``, description), ``additive``
        (False for causes of noise and acquisition), ``channels`` that it needs, ``locked_to``,
        ``parity``, ``channel`` of origin, ``look_alikes``, ``experiment`` that separates them, and
        ``source``; JSON-able.
    """
    groups = (name for name, causes in CAUSE_GROUPS.items() if cause in causes)
    return {
        "name": cause.name,
        "group": next(groups, _OWN),
        "equation": cause.equation,
        "parameters": [
            *(_parameter(p, "shape") for p in cause.shape),
            *(_parameter(p, "linear") for p in cause.linear),
        ],
        "additive": cause.additive,
        "channels": list(cause.channels),
        "locked_to": cause.locked_to,
        "parity": cause.parity,
        "channel": cause.channel,
        "look_alikes": list(cause.look_alikes),
        "experiment": cause.experiment,
        "source": cause.source,
    }


def describe_causes(extra: Iterable[Cause] = ()) -> list[dict[str, Any]]:
    """Return every cause as plain data.

    Parameters
    ----------
    extra : iterable of Cause
        Causes of the user's own.

    Returns
    -------
    list of dict
        As `describe_cause`: the names of the contract in its order, then those of installed
        packages, then `extra`.

    Raises
    ------
    DataError
        If a name is taken twice, or an installed package cannot give its causes.
    """
    return [describe_cause(cause) for cause in catalogue(extra).values()]


def _parameter(parameter: Parameter, kind: str) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "kind": kind,
        "unit": parameter.unit,
        "lower": parameter.lower,
        "upper": parameter.upper,
        "bands": [list(band) for band in parameter.bands],
        "description": parameter.description,
    }
