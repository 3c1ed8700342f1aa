"""The diagnosis section of a report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hdbench.report import inspection
from hdbench.report.diagnosis.limits import left_out_line, rest_line
from hdbench.report.diagnosis.tables import tables
from hdbench.report.numbers import (
    name_words,
    parameter_words,
    plain,
    short,
    stated,
    unit_of,
    unit_words,
    value_of,
)
from hdbench.report.pagemodel import KeyNumber, Level, Picture, Verdict
from hdbench.report.source import Source

__all__ = ["numbers", "pictures", "summary", "tables", "verdict"]

_VERDICTS: dict[str, tuple[Level, str]] = {
    "nothing-found": ("good", "Nothing found: the simulation explains the measurement."),
    "named": ("look", "The simulation misses something that can be named"),
    "unexplained": ("look", "The simulation misses something that has no name yet"),
    "named-and-unexplained": ("look", "The simulation misses several things, not all named"),
    "data-bad": ("bad", "The data do not allow a diagnosis."),
    "cannot-tell": ("look", "The record is too short or too noisy to tell."),
}

# what says where a cause sits and how large it is; the rest stands in the table
_TELLING = ("order", "frequency_hz", "amplitude_nm")
# findings that the verdict states with their size; of more it gives the names
_SIZED = 3


def verdict(result: Mapping[str, Any]) -> Verdict:
    """Say whether the simulation misses something, and what."""
    level, words = _VERDICTS.get(
        str(result.get("verdict")), ("look", f"Verdict {result.get('verdict')}.")
    )
    if level == "good" and rest_line(result):
        level, words = "look", "Nothing found, but more is left than noise."
    causes, left = result.get("causes", ()), result.get("unexplained", ())
    if len(causes) + len(left) > _SIZED:
        names = [str(cause.get("name")) for cause in causes]
        places = [f"unexplained at {place.get('domain')}" for place in left]
    else:
        names = [_cause_words(cause) for cause in causes]
        places = [_place_words(place) for place in left]
    if names or places:
        words = words.rstrip(".") + ": " + "; ".join([*names, *places]) + "."
    elif result.get("reason"):
        words = f"{words} {result['reason']}"
    return Verdict(level, words, tuple(_limits(result)))


def _limits(result: Mapping[str, Any]) -> Iterator[str]:
    """Say what took no part and what is left above the noise."""
    left_out, rest = left_out_line(result), rest_line(result)
    if left_out:
        yield f"Left out: {left_out}."
    if rest:
        yield f"Rest: {unit_words(rest)}."


def _cause_words(cause: Mapping[str, Any]) -> str:
    parameters = cause.get("parameters", {})
    telling = [name for name in _TELLING if name in parameters]
    sized = [name for name, body in parameters.items() if body.get("unit") == "N m"]
    chosen = telling or sized[:1]
    parts = [parameter_words(name, parameters[name]) for name in chosen]
    return f"{cause.get('name')} ({', '.join(parts)})" if parts else str(cause.get("name"))


def _place_words(place: Mapping[str, Any]) -> str:
    size = place.get("size_nm")
    tail = f" of {short(float(size))} N·m" if isinstance(size, int | float) else ""
    return (
        f"unexplained{tail} at {place.get('domain')} {plain(place.get('location'))} "
        f"{place.get('unit') or ''}".strip()
    )


def summary(result: Mapping[str, Any], _source: Source) -> str:
    """Say in plain words what was found and what it is worth."""
    before, after = (value_of(result, key, "heldout_rms_nm") for key in ("simulated", "extended"))
    text = "The measured torque was held against the simulation of the same motion. "
    causes = result.get("causes", ())
    if causes:
        names = ", ".join(str(cause["name"]) for cause in causes)
        text += f"What is left over is explained by {names}. "
        rivals = dict.fromkeys(str(r) for cause in causes for r in cause.get("rivals", ()))
        if rivals:
            text += f"Nearly as likely on this record: {', '.join(rivals)}. "
    elif result.get("verdict") == "nothing-found":
        text += "What is left over looks like noise: no order, tone or trend stands out. "
    places = result.get("unexplained", ())
    if places:
        text += (
            "One further place of the residual stands out without a name. "
            if len(places) == 1
            else f"{len(places)} further places of the residual stand out without a name. "
        )
    if before and after is not None:
        text += (
            f"On parts of the record that took no part in the fit, the simulation misses the "
            f"measurement by {short(before)} N·m rms, the extended one by {short(after)} N·m rms "
            f"({100.0 * (1.0 - (after / before) ** 2):.1f} % of the residual variance explained). "
        )
    return text + _filter_words(result.get("filter_gain"))


def _filter_words(gain: Any) -> str:
    """Say what the filter gains by the orders found; nothing where there is no such figure."""
    if not isinstance(gain, Mapping):
        return ""
    rms = gain["error_rms_nm"]
    told = ((block["order"], block["amplitude_nm"]) for block in gain["blocks"])
    sizes = " and ".join(
        f"{short(float(size['after']))} N·m of motor order {plain(order)} "
        f"(before: {short(float(size['before']))} N·m)"
        for order, size in told
    )
    return (
        f"With the new orders as blocks, the filter leaves {sizes}; its error is "
        f"{short(float(rms['after']))} N·m rms (before: {short(float(rms['before']))} N·m rms). "
    )


def numbers(result: Mapping[str, Any], run_id: str) -> tuple[KeyNumber, ...]:
    """Return the parameters of every cause and the gain on held-out data."""
    rows: list[tuple[Any, str, str, str]] = []
    for i, cause in enumerate(result.get("causes", ())):
        parameters = cause.get("parameters", {})
        for name, body in ((x, parameters[x]) for x in stated(parameters)):
            key = f"causes[{i}].parameters.{name}"
            rows.append((body, f"{cause['name']}: {name_words(str(name))}", key, unit_of(body)))
    for key, words in (("simulated", "simulation"), ("extended", "extended")):
        name = f"{key}.heldout_rms_nm"
        rms = value_of(result, key, "heldout_rms_nm")
        rows.append((rms, f"held-out residual, {words}", name, "N m"))
    return KeyNumber.rows(rows, run_id)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the residual before and after, in every domain."""
    from hdbench.report.diagnosis.figures import folder_pictures

    drawn = folder_pictures(source.folder, prefix)
    if not drawn:
        doubts.append("residual.csv is not there: the residual is not drawn.")
    inspected = source.result.get("inspection")
    bands = inspection.picture(inspected, prefix) if inspected and drawn else None
    return drawn if bands is None else (*drawn, bands)
