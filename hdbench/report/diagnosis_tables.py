"""The tables of a diagnosis: causes, places without a name, and what could have been missed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.elements import Table
from hdbench.report.numbers import DASH, parameter_words, plain, probability

__all__ = ["tables"]

_CAUSE_HEAD = (
    "cause",
    "parameters",
    "explains",
    "false-alarm probability",
    "same on this record",
    "told apart by",
)
_PLACE_HEAD = ("domain", "place", "extent", "size (N·m)", "share of variance")
_LEAST_HEAD = ("cause", "amplitude (N·m)")


def tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """List causes, unexplained places and what could have been missed.

    Parameters
    ----------
    result : mapping
        The diagnosis result.

    Returns
    -------
    tuple of Table
        Those that have rows.
    """
    causes = tuple(_cause_row(cause) for cause in result.get("causes", ()))
    minor = tuple(_cause_row(cause) for cause in result.get("minor", ()))
    places = tuple(_place_row(place) for place in result.get("unexplained", ()))
    least = tuple(
        (str(m.get("name")), plain(m.get("amplitude_nm")))
        for m in result.get("minimum_detectable", ())
    )
    found = (
        Table("Causes", _CAUSE_HEAD, causes),
        Table("Smaller causes", _CAUSE_HEAD, minor),
        Table("Unexplained", _PLACE_HEAD, places),
        Table("Smallest effect this record would have shown", _LEAST_HEAD, least),
    )
    return tuple(table for table in found if table.rows)


def _cause_row(cause: Mapping[str, Any]) -> tuple[str, ...]:
    parameters = "; ".join(
        parameter_words(str(name), body) for name, body in cause.get("parameters", {}).items()
    )
    gain = cause.get("gain") or {}
    same = [str(x) for x in (*cause.get("group", ()), *cause.get("rivals", ()))]
    return (
        str(cause.get("name")),
        parameters,
        _percent(gain.get("explained_fraction")),
        probability(cause.get("false_alarm_probability")),
        ", ".join(name for name in dict.fromkeys(same) if name != cause.get("name")) or DASH,
        plain(cause.get("separating_experiment")),
    )


def _place_row(place: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(place.get("domain")),
        f"{plain(place.get('location'))} {place.get('unit') or ''}",
        plain(place.get("extent")),
        plain(place.get("size_nm")),
        _percent(place.get("share_of_variance")),
    )


def _percent(value: Any) -> str:
    return f"{100.0 * value:.1f} %" if isinstance(value, int | float) else DASH
