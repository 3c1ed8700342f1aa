"""The diagnosis section of a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.elements import KeyNumber, Level, Picture, Table, Verdict
from hdbench.report.numbers import DASH, key_number, plain, probability, short, unit_words
from hdbench.report.source import Source, read_columns

__all__ = ["numbers", "pictures", "summary", "tables", "verdict"]

_VERDICTS: dict[str, tuple[Level, str]] = {
    "nothing-found": ("good", "Nothing found: the simulation explains the measurement."),
    "named": ("look", "The simulation misses something that can be named"),
    "unexplained": ("look", "The simulation misses something that has no name yet"),
    "named-and-unexplained": ("look", "The simulation misses several things, not all named"),
    "data-bad": ("bad", "The data do not allow a diagnosis."),
    "cannot-tell": ("look", "The record is too short or too noisy to tell."),
}

_SUFFIXES = ("_rad_s", "_nm", "_hz", "_rad", "_s", "_v")
# what says where a cause sits and how large it is; the rest stands in the table
_TELLING = ("order", "frequency_hz", "amplitude_nm")
# the same amplitude and phase once more
_QUADRATURES = ("cosine_nm", "sine_nm")


def verdict(result: Mapping[str, Any]) -> Verdict:
    """Say whether the simulation misses something, and what.

    Parameters
    ----------
    result : mapping
        The diagnosis result (contract section 5).

    Returns
    -------
    Verdict
    """
    level, words = _VERDICTS.get(
        str(result.get("verdict")), ("look", f"Verdict {result.get('verdict')}.")
    )
    names = [_cause_words(cause) for cause in result.get("causes", ())]
    places = [_place_words(place) for place in result.get("unexplained", ())]
    if names or places:
        words = words.rstrip(".") + ": " + "; ".join([*names, *places]) + "."
    elif result.get("reason"):
        words = f"{words} {result['reason']}"
    return Verdict(level, words)


def _cause_words(cause: Mapping[str, Any]) -> str:
    parameters = cause.get("parameters", {})
    telling = [name for name in _TELLING if name in parameters]
    sized = [name for name, body in parameters.items() if body.get("unit") == "N m"]
    chosen = telling or sized[:1]
    parts = [_parameter_words(name, parameters[name]) for name in chosen]
    return f"{cause.get('name')} ({', '.join(parts)})" if parts else str(cause.get("name"))


def _words(name: str) -> str:
    """Return a parameter's name without the unit that stands beside it anyway."""
    for suffix in _SUFFIXES:
        name = name.removesuffix(suffix)
    return name.replace("_", " ")


def _unit(body: Mapping[str, Any]) -> str:
    unit = str(body.get("unit") or "")
    return "" if unit == "1" else unit.replace("N m", "N m")


def _parameter_words(name: str, body: Mapping[str, Any]) -> str:
    return f"{_words(name)} {plain(body)} {unit_words(_unit(body))}".strip()


def _place_words(place: Mapping[str, Any]) -> str:
    size = place.get("size_nm")
    tail = f" of {short(float(size))} N·m" if isinstance(size, int | float) else ""
    return (
        f"unexplained{tail} at {place.get('domain')} {plain(place.get('location'))} "
        f"{place.get('unit') or ''}".strip()
    )


def _rms(result: Mapping[str, Any], key: str) -> float | None:
    body = result.get(key)
    value = body.get("heldout_rms_nm") if isinstance(body, Mapping) else None
    return float(value) if isinstance(value, int | float) else None


def summary(result: Mapping[str, Any], _source: Source) -> str:
    """Say in plain words what was found and what it is worth.

    Parameters
    ----------
    result : mapping
        The diagnosis result.
    _source : Source
        The run.

    Returns
    -------
    str
        One paragraph.
    """
    before, after = _rms(result, "simulated"), _rms(result, "extended")
    text = "The measured torque was held against the simulation of the same motion. "
    causes = result.get("causes", ())
    if causes:
        names = ", ".join(str(cause["name"]) for cause in causes)
        text += f"What is left over is explained by {names}. "
        rivals = [str(r) for cause in causes for r in cause.get("rivals", ())]
        if rivals:
            text += f"Nearly as likely on this record: {', '.join(rivals)}. "
    elif result.get("verdict") == "nothing-found":
        text += "What is left over looks like noise: no order, tone or trend stands out. "
    places = result.get("unexplained", ())
    if places:
        text += f"{len(places)} further place(s) of the residual stand out without a name. "
    if before and after is not None:
        text += (
            f"On parts of the record that took no part in the fit, the simulation misses the "
            f"measurement by {short(before)} N·m rms, the extended one by {short(after)} N·m rms "
            f"({100.0 * (1.0 - (after / before) ** 2):.0f} % of the residual variance explained). "
        )
    return text


def numbers(result: Mapping[str, Any], source: Source) -> tuple[KeyNumber, ...]:
    """Return the parameters of every cause and the gain on held-out data.

    Parameters
    ----------
    result : mapping
        The diagnosis result.
    source : Source
        The run.

    Returns
    -------
    tuple of KeyNumber
        Those that the result holds.
    """
    rows: list[tuple[Any, str, str, str]] = []
    for i, cause in enumerate(result.get("causes", ())):
        parameters = cause.get("parameters", {})
        shown = [x for x in parameters if x not in _QUADRATURES or "amplitude_nm" not in parameters]
        for name, body in ((x, parameters[x]) for x in shown):
            key = f"causes[{i}].parameters.{name}"
            rows.append((body, f"{cause['name']}: {_words(str(name))}", key, _unit(body)))
    rows += [
        (
            _rms(result, "simulated"),
            "held-out residual, simulation",
            "simulated.heldout_rms_nm",
            "N m",
        ),
        (_rms(result, "extended"), "held-out residual, extended", "extended.heldout_rms_nm", "N m"),
    ]
    made = (
        key_number(b, label, key, unit, f"{source.run_id}: {key}") for b, label, key, unit in rows
    )
    return tuple(number for number in made if number is not None)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the residual before and after, over time, motor order and frequency.

    Parameters
    ----------
    source : Source
        The run.
    prefix : str
        Word that makes the figures' ids unique on the page.
    doubts : list of str
        Reasons why a figure is missing are appended.

    Returns
    -------
    tuple of Picture
        Those for which the run holds data.
    """
    from hdbench.report.figures_residual import residual_pictures

    columns = read_columns(source.folder / "residual.csv")
    if columns is None:
        doubts.append("residual.csv is not there: the residual is not drawn.")
        return ()
    spectra = {
        file.stem: table
        for file in sorted(source.folder.glob("*spectrum*.csv"))
        if (table := read_columns(file)) is not None
    }
    return residual_pictures(columns, spectra, prefix)


def tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """List causes, unexplained places and what could have been missed.

    Parameters
    ----------
    result : mapping
        The diagnosis result.

    Returns
    -------
    tuple of Table
    """
    found = []
    for key, title in (("causes", "Causes"), ("minor", "Smaller causes")):
        rows = tuple(_cause_row(cause) for cause in result.get(key, ()))
        if rows:
            head = (
                "cause",
                "parameters",
                "explains",
                "false-alarm probability",
                "same on this record",
                "told apart by",
            )
            found.append(Table(title, head, rows))
    places = tuple(
        (
            str(p.get("domain")),
            f"{plain(p.get('location'))} {p.get('unit') or ''}",
            plain(p.get("extent")),
            plain(p.get("size_nm")),
            _percent(p.get("share_of_variance")),
        )
        for p in result.get("unexplained", ())
    )
    if places:
        columns = ("domain", "place", "extent", "size (N·m)", "share of variance")
        found.append(Table("Unexplained", columns, places))
    least = tuple(
        (str(m.get("name")), plain(m.get("amplitude_nm")))
        for m in result.get("minimum_detectable", ())
    )
    if least:
        found.append(
            Table(
                "Smallest effect this record would have shown", ("cause", "amplitude (N·m)"), least
            )
        )
    return tuple(found)


def _cause_row(cause: Mapping[str, Any]) -> tuple[str, ...]:
    parameters = "; ".join(
        _parameter_words(str(name), body) for name, body in cause.get("parameters", {}).items()
    )
    gain = cause.get("gain") or {}
    alarm = cause.get("false_alarm_probability")
    same = [str(x) for x in (*cause.get("group", ()), *cause.get("rivals", ()))]
    return (
        str(cause.get("name")),
        parameters,
        _percent(gain.get("explained_fraction")),
        probability(alarm),
        ", ".join(name for name in dict.fromkeys(same) if name != cause.get("name")) or DASH,
        plain(cause.get("separating_experiment")),
    )


def _percent(value: Any) -> str:
    return f"{100.0 * value:.1f} %" if isinstance(value, int | float) else DASH
