"""A diagnosis on one screen: measured, simulated, difference; causes; what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.report.diagnosis.limits import left_out_line, rest_line
from hdbench_cli.commands.diagnosis_baseline import baseline_lines
from hdbench_cli.commands.diagnosis_names import names_line
from hdbench_cli.commands.diagnosis_records import record_lines, voice_lines
from hdbench_cli.numbers import probability, with_uncertainty
from hdbench_cli.sparkline import read_columns, span_of, sparkline

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["show"]

_WORDS = {
    "nothing-found": "Nothing found: the simulation explains the measurement.",
    "named": "The simulation misses something, and it has a name.",
    "unexplained": "The simulation misses something that has no name yet.",
    "named-and-unexplained": "The simulation misses several things; not all have a name.",
    "data-bad": "The data do not allow a diagnosis.",
    "cannot-tell": "These data cannot tell.",
}
_LEFT = "Nothing found, but more is left than noise."
# findings of the inspection that are named
_SHOWN_FINDINGS = 3
# effects listed with the smallest size that would have been found, beside causes and alone
_SHOWN_LIMITS = 2
_SHOWN_LIMITS_ALONE = 12
# more causes than this are drawn without their sketch, so that all fit on one screen
_SKETCHED = 3
_LABEL = 11
# room for the arrow and the words beside a sketch: the longest axis with its ends
_SKETCH_WORDS = 46
# table and columns of the picture that shows a domain plainest
_SKETCHES = {
    "motor-order": ("order_spectrum.csv", "motor_order", "motor order"),
    "output-order": ("output_order_spectrum.csv", "output_order", "output order"),
    "frequency": ("frequency_spectrum.csv", "frequency_hz", "frequency, Hz"),
    "velocity": ("map_velocity.csv", "motor_velocity_rad_s", "velocity, rad/s"),
    "acceleration": ("map_acceleration.csv", "motor_acceleration_rad_s2", "acceleration, rad/s2"),
    "torque": ("map_torque.csv", "applied_torque_nm", "torque, N m"),
    "time": ("map_time.csv", "time_s", "time, s"),
    "variance": ("map_variance.csv", "absolute_velocity_rad_s", "abs velocity, rad/s"),
    "position": ("map_output_angle.csv", "output_angle_rad", "output angle, rad"),
}


def show(console: Console, result: Mapping[str, Any], folder: Path | None = None) -> None:
    """Draw a diagnosis on one screen."""
    if folder is not None:
        _comparison(console, folder)
    words = _WORDS[result["verdict"]]
    if result["verdict"] == "nothing-found" and rest_line(result):
        words = _LEFT
    console.print(words, style="bold", markup=False)
    if result["reason"]:
        console.print(result["reason"], markup=False)
    _show_words(console, "log", _log_line(result.get("inspection")))
    _show_words(console, "left out", left_out_line(result))
    _show_part(console, result.get("part"))
    sketched = folder if len(result["causes"]) <= _SKETCHED else None
    told: set[str] = set()
    for cause in result["causes"]:
        _show_cause(console, cause, sketched, told)
    for place in result["unexplained"]:
        _show_place(console, place)
    small = [cause["name"] for cause in result["minor"]]
    small += [f"{one['domain']} {one['location']:.4g}" for one in result["minor_unexplained"]]
    if small:
        console.print(f"{'minor':<{_LABEL}}{', '.join(small)}", markup=False)
    for line in baseline_lines(result["settings"], _LABEL):
        console.print(line, markup=False)
    _show_gain(console, result, folder)
    for line in record_lines(result):
        console.print(f"{'record':<{_LABEL}}{line}", markup=False)
    alone = not result["causes"] and not result["unexplained"]
    _show_words(console, "testable", names_line(result, None if alone else console.width - _LABEL))
    for flag in result["data_flags"]:
        console.print(
            f"{'flag':<{_LABEL}}{flag['name']}: {flag['samples']} samples, "
            f"{flag['from_s']:.3f} to {flag['to_s']:.3f} s"
            + (f" of {flag['record']}" if flag.get("record") else ""),
            markup=False,
        )


def _log_line(inspection: Mapping[str, Any] | None) -> str:
    """Return the rate of the log and what limits it; nothing for loads, which have no clock."""
    if inspection is None or inspection["sampling"]["rate_hz"] is None:
        return ""
    found = [f"{one['name']} {one['channel'] or ''}".strip() for one in inspection["findings"]]
    shown = ", ".join(found[:_SHOWN_FINDINGS])
    more = f" and {len(found) - _SHOWN_FINDINGS} more" if len(found) > _SHOWN_FINDINGS else ""
    told = f"{shown}{more} (hdbench inspect)" if found else "nothing limits it"
    return f"{inspection['sampling']['rate_hz']:.5g} Hz: {told}"


def _plain(console: Console) -> bool:
    return not (console.encoding or "").lower().startswith("utf")


def _comparison(console: Console, folder: Path) -> None:
    """Draw measured, simulated and their difference over time."""
    table = read_columns(folder / "residual.csv")
    if table is None:
        return
    measured, simulated = table["measured_nm"], table["simulated_nm"]
    difference = [m - s for m, s in zip(measured, simulated, strict=True)]
    everything = {"measured": measured, "simulated": simulated, "difference": difference}
    width = max(10, min(console.width, 100) - _LABEL - 22)
    width = min(width, len(measured))
    smooth = {name: _means(values, width) for name, values in everything.items()}
    span = span_of(smooth, *smooth)
    for name, values in everything.items():
        line = sparkline(smooth[name], width, span, plain=_plain(console))
        rms = _rms(values)
        size = "none" if rms is None else f"{rms:.4g} N m rms"
        console.print(f"{name:<{_LABEL}}{line}  {size}", markup=False, highlight=False)


def _means(values: list[float], count: int) -> list[float]:
    """Return the means of `count` equal parts; NaN where a part holds nothing."""
    out = []
    for place in range(count):
        part = values[place * len(values) // count : (place + 1) * len(values) // count]
        good = [value for value in part if math.isfinite(value)]
        out.append(sum(good) / len(good) if good else math.nan)
    return out


def _rms(values: list[float]) -> float | None:
    good = [value * value for value in values if math.isfinite(value)]
    return math.sqrt(sum(good) / len(good)) if good else None


def _quantity(name: str, entry: Mapping[str, Any]) -> str:
    unit = "" if entry["unit"] in ("1", None) else str(entry["unit"])
    plain = name
    for ending in ("_nm_per_s", "_nm_s_per_rad", "_nm", "_rad_s", "_rad", "_hz", "_s", "_kg_m2"):
        if name.endswith(ending):
            plain = name.removesuffix(ending)
            break
    words = plain.replace("_", " ")
    if entry["std"] is None:
        return f"{words} {entry['value']:.5g} {unit}".rstrip()
    return f"{words} {with_uncertainty({**entry, 'dof': None}, unit)}".rstrip()


def _parameters(cause: Mapping[str, Any]) -> str:
    shown = [
        _quantity(name, entry)
        for name, entry in cause["parameters"].items()
        if not name.startswith(("cosine", "sine")) and entry["value"] is not None
    ]
    return ", ".join(shown)


def _show_words(console: Console, label: str, words: str) -> None:
    """Show a line of words behind its label, nothing where there are none."""
    if words:
        console.print(f"{label:<{_LABEL}}{words}", markup=False, highlight=False)


def _show_part(console: Console, part: Mapping[str, Any] | None) -> None:
    if part is None:
        return
    words = f"{part['from_s']:g} to {part['to_s']:g} s"
    if part["cut"]:
        words += ": the most that one diagnosis takes; --from-s names others"
    console.print(f"{'part':<{_LABEL}}{words}", markup=False)


def _show_cause(
    console: Console, cause: Mapping[str, Any], folder: Path | None, told: set[str]
) -> None:
    """Show a cause; an experiment that was told with another one is not told again."""
    from rich.text import Text

    others = [name for name in (*cause["group"], *cause["rivals"]) if name != cause["name"]]
    head = Text(cause["name"], style="bold")
    if others:
        head.append(f"  (or {', '.join(others)})", style="not bold")
    console.print(head)
    console.print(f"  {_parameters(cause)}", markup=False)
    gain = cause["gain"]
    low, high = gain["interval"]
    chance = probability(cause["false_alarm_probability"])
    console.print(
        f"  explains {100.0 * gain['explained_fraction']:.1f} % "
        f"({100.0 * low:.1f} to {100.0 * high:.1f}): {gain['heldout_rms_before_nm']:.3g} -> "
        f"{gain['heldout_rms_after_nm']:.3g} N m, "
        f"false alarm {chance}",
        markup=False,
    )
    for line in voice_lines(cause):
        console.print(f"  {line}", markup=False)
    if folder is not None:
        _sketch(console, str(cause.get("domain")), folder)
    experiment = cause["separating_experiment"]
    if experiment and experiment not in told:
        told.add(experiment)
        console.print(f"  told apart by: {experiment}", markup=False)


def _sketch(console: Console, domain: str, folder: Path) -> None:
    """Draw the residual before and after in the domain where it is plainest."""
    if domain not in _SKETCHES:
        return
    file, axis, words = _SKETCHES[domain]
    table = read_columns(folder / file)
    if table is None or len(table[axis]) < 2:
        return
    spectrum = "samples" not in table
    width = max(8, (min(console.width, 100) - _SKETCH_WORDS) // 2)
    curves = {key: table[key] for key in ("before_nm", "after_nm")}
    if spectrum:
        curves = {key: _peaks(values, width) for key, values in curves.items()}
    low, high = span_of(curves, *curves)
    span = (0.0, high) if spectrum else (low, high)
    before, after = (sparkline(curves[key], width, span, plain=_plain(console)) for key in curves)
    first, last = table[axis][0], table[axis][-1]
    console.print(
        f"  {before} -> {after}  {words} {first:.3g} to {last:.3g}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )


def _peaks(values: list[float], count: int) -> list[float]:
    """Return the largest of each of `count` equal parts: a line must not be averaged away."""
    out = []
    for place in range(count):
        part = values[place * len(values) // count : (place + 1) * len(values) // count]
        out.append(max((v for v in part if math.isfinite(v)), default=math.nan))
    return out


def _show_place(console: Console, place: Mapping[str, Any]) -> None:
    low, high = place["extent"]
    unit = "" if place["unit"] == "1" else f" {place['unit']}"
    second = f", with {place['second_domain']}" if place.get("second_domain") else ""
    second += f", in {place['record']}" if place.get("record") else ""
    console.print(
        f"unexplained at {place['domain']} {place['location']:.6g}{unit} "
        f"({low:.6g} to {high:.6g}){second}\n"
        f"  size {place['size_nm']:.3g} N m, "
        f"{100.0 * place['share_of_variance']:.1f} % of the residual variance",
        markup=False,
    )


def _show_gain(console: Console, result: Mapping[str, Any], folder: Path | None) -> None:
    before = result["simulated"]["heldout_rms_nm"]
    after = result["extended"]["heldout_rms_nm"]
    if before is not None and after is not None:
        console.print(
            f"{'held-out':<{_LABEL}}{before:.4g} N m rms simulated, {after:.4g} N m rms extended",
            markup=False,
        )
    _show_words(console, "rest", rest_line(result))
    gain = result.get("filter_gain")
    if gain:
        rms = gain["error_rms_nm"]
        sizes = [
            f"order {block['order']:.6g}: {block['amplitude_nm']['before']:.3g} -> "
            f"{block['amplitude_nm']['after']:.3g} N m"
            for block in gain["blocks"]
        ]
        console.print(
            f"{'filter':<{_LABEL}}with new blocks {', '.join(sizes)}; "
            f"off by {rms['before']:.3g} -> {rms['after']:.3g} N m rms",
            markup=False,
        )
    open_run = result.get("separating_run")
    if open_run and open_run["file"] and folder is not None:
        console.print(
            f"{'next':<{_LABEL}}hdbench run-ripple --plan {folder / open_run['file']}",
            markup=False,
            soft_wrap=True,
        )
    alone = not result["causes"] and not result["unexplained"]
    limits = result["minimum_detectable"][: _SHOWN_LIMITS_ALONE if alone else _SHOWN_LIMITS]
    if limits:
        words = [f"{limit['name']} {limit['amplitude_nm']:.2g}" for limit in limits]
        console.print(f"{'limits':<{_LABEL}}90 % seen from, N m: {', '.join(words)}", markup=False)
