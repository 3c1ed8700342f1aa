"""The catalogue of causes as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hdbench.model import Cause, Parameter, catalogue

__all__ = ["describe_causes"]


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


def _entry(cause: Cause) -> dict[str, Any]:
    return {
        "name": cause.name,
        "equation": cause.equation,
        "parameters": [
            *(_parameter(p, "shape") for p in cause.shape),
            *(_parameter(p, "linear") for p in cause.linear),
        ],
        "locked_to": cause.locked_to,
        "parity": cause.parity,
        "channel": cause.channel,
        "look_alikes": list(cause.look_alikes),
        "experiment": cause.experiment,
        "source": cause.source,
    }


def describe_causes(own: Iterable[Cause] = ()) -> list[dict[str, Any]]:
    """Return every cause that a diagnosis can name.

    Parameters
    ----------
    own : iterable of Cause
        Causes beside the catalogue.

    Returns
    -------
    list of dict
        Name, equation, parameters with units and domains, what it is locked to, parity, channel
        of origin, look-alikes, the experiment that separates them, and source; JSON-able.
    """
    return [_entry(cause) for cause in catalogue(own).values()]
