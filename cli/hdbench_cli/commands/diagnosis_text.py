"""A diagnosis on one screen: measured, simulated, difference; causes; what is left."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdbench.records import FloatArray
from hdbench.report.diagnosis.folder import read_columns
from hdbench.report.diagnosis.limits import hidden_names, left_out_line, rest_line
from hdbench.report.numbers import name_words
from hdbench.results import diagnosis
from hdbench_cli.output import Output
from hdbench_cli.text import (
    Lines,
    probability,
    sparkline,
    with_uncertainty,
    wrapped,
)

if TYPE_CHECKING:
    from rich.console import Console


_VERDICTS = {
    "nothing-found": "Nothing found: what the simulation leaves looks like noise.",
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
_SHOWN_LIMITS, _SHOWN_LIMITS_ALONE = 2, 12
# more causes than this are drawn without their sketch, so that all fit on one screen
_SKETCHED = 3
_LABEL = 11
# names of one reason, and characters of all, that are written out: three lines of 80
_SHOWN_NAMES, _NAMES_ROOM = 2, 210
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


def lines(
    result: diagnosis.DiagnosisResult, folder: Path | None = None, console: Console | None = None
) -> Lines:
    """Yield a diagnosis, with curves from the files in its folder where there is one.

    Sentences may be wrapped; curves, and a command to copy, stay on one line.
    """
    console = console or Output.console()
    plain = not (console.encoding or "").lower().startswith("utf")
    width = min(console.width, 100)
    if folder is not None:
        yield from _comparison(folder, width, plain)
    left = result.verdict == "nothing-found" and rest_line(result)
    yield wrapped(_LEFT if left else _VERDICTS[result.verdict], "bold")
    if result.reason:
        yield wrapped(result.reason)
    yield from _labelled("log", _log_line(result.inspection))
    yield from _labelled("left out", left_out_line(result))
    yield from _labelled("part", _part(result.part))
    sketched = folder if len(result.causes) <= _SKETCHED else None
    told: set[str] = set()
    for cause in result.causes:
        yield from _cause(cause)
        if sketched is not None:
            yield from _sketch(cause.domain, sketched, width, plain)
        # an experiment that was told with another cause is not told again
        experiment = cause.separating_experiment
        if experiment and experiment not in told:
            told.add(experiment)
            yield wrapped(f"  told apart by: {experiment}")
    for place in result.unexplained:
        yield from _place(place)
    small = [cause.name for cause in result.minor]
    small += [f"{one.domain} {one.location:.4g}" for one in result.minor_unexplained]
    yield from _labelled("minor", ", ".join(small))
    yield from _baseline(result.settings)
    yield from _gain(result, folder)
    for record in result.records:
        yield from _labelled("record", _record(record, result))
    alone = not result.causes and not result.unexplained
    room = None if alone else console.width - _LABEL
    yield from _labelled("testable", names_line(result, room))
    for flag in result.data_flags:
        of = f" of {flag.record}" if flag.record else ""
        span = f"{flag.from_s:.3f} to {flag.to_s:.3f} s{of}"
        yield from _labelled("flag", f"{flag.name}: {flag.samples} samples, {span}")


def _labelled(label: str, words: str) -> Lines:
    """Yield words behind their label; nothing where there are none."""
    if words:
        yield wrapped(f"{label:<{_LABEL}}{words}")


def _log_line(inspection: Mapping[str, Any] | None) -> str:
    """Return the rate of the log and what limits it; nothing for loads, which have no clock."""
    if inspection is None or inspection["sampling"]["rate_hz"] is None:
        return ""
    found = [f"{one['name']} {one['channel'] or ''}".strip() for one in inspection["findings"]]
    shown = ", ".join(found[:_SHOWN_FINDINGS])
    more = f" and {len(found) - _SHOWN_FINDINGS} more" if len(found) > _SHOWN_FINDINGS else ""
    told = f"{shown}{more} (hdbench inspect)" if found else "nothing limits it"
    return f"{inspection['sampling']['rate_hz']:.5g} Hz: {told}"


def _comparison(folder: Path, width: int, plain: bool) -> Iterator[str]:
    """Yield measured, simulated and their difference over time."""
    table = read_columns(folder / "residual.csv")
    if table is None:
        return
    measured, simulated = table["measured_nm"], table["simulated_nm"]
    everything = {
        "measured": measured,
        "simulated": simulated,
        "difference": measured - simulated,
    }
    room = min(max(10, width - _LABEL - 22), len(measured))
    smooth = {name: _parts(values, room, np.mean) for name, values in everything.items()}
    span = _span(smooth.values())
    for name, values in everything.items():
        known = values[np.isfinite(values)]
        size = f"{np.sqrt(np.mean(known**2)):.4g} N m rms" if len(known) else "none"
        yield f"{name:<{_LABEL}}{sparkline(smooth[name], room, span, plain=plain)}  {size}"


def _parts(values: FloatArray, count: int, number: Callable[[FloatArray], Any]) -> list[float]:
    """Return a number of the finite values in each of `count` equal parts."""
    ends = [place * len(values) // count for place in range(count + 1)]
    parts = (values[a:b][np.isfinite(values[a:b])] for a, b in pairwise(ends))
    return [float(number(part)) if len(part) else math.nan for part in parts]


def _span(curves: Iterable[Sequence[float] | FloatArray]) -> tuple[float, float]:
    """Return lowest and highest finite value of some curves, the span of a common picture."""
    values = np.concatenate([np.asarray(curve, dtype=float) for curve in curves])
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)


def _part(part: diagnosis.DiagnosedPart | None) -> str:
    if part is None:
        return ""
    cut = ": the most that one diagnosis takes; --from-s names others" if part.cut else ""
    return f"{part.from_s:g} to {part.to_s:g} s{cut}"


def _size(value: float, std: float | None, unit: str) -> str:
    """Return a number with its uncertainty, without degrees of freedom."""
    return with_uncertainty({"value": value, "std": std, "dof": None}, unit)


def _parameter(name: str, found: diagnosis.ParameterValue) -> str:
    unit = "" if found.unit == "1" else found.unit
    number = f"{found.value:.5g} {unit}"
    if found.std is not None:
        number = _size(found.value, found.std, unit)
    return f"{name_words(name)} {number}".rstrip()


def _cause(cause: diagnosis.NamedCause) -> Lines:
    others = [name for name in (*cause.group, *cause.rivals) if name != cause.name]
    head = wrapped(cause.name, "bold")
    if others:
        head.append(f"  (or {', '.join(others)})", style="not bold")
    yield head
    shown = [
        _parameter(name, found)
        for name, found in cause.parameters.items()
        if not name.startswith(("cosine", "sine"))
    ]
    yield wrapped(f"  {', '.join(shown)}")
    gain = cause.gain
    low, high = gain.interval
    yield wrapped(
        f"  explains {100.0 * gain.explained_fraction:.1f} % "
        f"({100.0 * low:.1f} to {100.0 * high:.1f}): {gain.heldout_rms_before_nm:.3g} -> "
        f"{gain.heldout_rms_after_nm:.3g} N m, "
        f"false alarm {probability(cause.false_alarm_probability)}"
    )
    if not cause.voices:
        return
    said = ", ".join(f"{one.record} {one.evidence_nats:+.3g}" for one in cause.voices)
    yield wrapped(f"  evidence by record, nats: {said}")
    apart = [one.record for one in cause.voices if one.disagrees]
    if apart:
        yield wrapped(f"  records disagree: {', '.join(apart)}")
        yield from (wrapped(f"    {one.record}: {_sizes(one)}") for one in cause.voices)


def _sizes(voice: diagnosis.Voice) -> str:
    """Return the sizes of a cause in one record, without what an amplitude says too."""
    shown = [
        f"{name} {_size(found.value, found.std, found.unit)}"
        for name, found in voice.parameters.items()
        if not name.startswith(("cosine", "sine", "phase")) and found.std is not None
    ]
    return ", ".join(shown) or "does not show it"


def _sketch(domain: str, folder: Path, width: int, plain: bool) -> Iterator[str]:
    """Yield the residual before and after in the domain where it is plainest."""
    if domain not in _SKETCHES:
        return
    file, axis, words = _SKETCHES[domain]
    table = read_columns(folder / file)
    if table is None or len(table[axis]) < 2:
        return
    room = max(8, (width - _SKETCH_WORDS) // 2)
    spectrum = "samples" not in table
    # a line of a spectrum must not be averaged away
    curves = [
        _parts(table[key], room, np.max) if spectrum else table[key].tolist()
        for key in ("before_nm", "after_nm")
    ]
    low, high = _span(curves)
    span = (0.0 if spectrum else low, high)
    before, after = (sparkline(values, room, span, plain=plain) for values in curves)
    yield f"  {before} -> {after}  {words} {table[axis][0]:.3g} to {table[axis][-1]:.3g}"


def _place(place: diagnosis.Unexplained) -> Lines:
    low, high = place.extent
    unit = "" if place.unit == "1" else f" {place.unit}"
    second = f", with {place.second_domain}" if place.second_domain else ""
    second += f", in {place.record}" if place.record else ""
    yield wrapped(
        f"unexplained at {place.domain} {place.location:.6g}{unit} "
        f"({low:.6g} to {high:.6g}){second}"
    )
    share = 100.0 * place.share_of_variance
    yield wrapped(f"  size {place.size_nm:.3g} N m, {share:.1f} % of the residual variance")


def _baseline(settings: Mapping[str, Any]) -> Lines:
    """Yield the ripple that the baseline took, and what the motion cannot tell from the zero."""
    ripple = [
        f"order {one['order']:g}: {_size(one['amplitude_nm'], one['std_nm'], 'N m')}"
        for one in settings.get("baseline_ripple", ())
    ]
    if ripple:
        yield from _labelled("baseline", f"ripple of {', '.join(ripple)}")
    alike = settings.get("not_told_from_zero", ())
    if alike:
        shares = [100.0 * one["own_share"] for one in alike]
        low, high = f"{min(shares):.0f}", f"{max(shares):.0f}"
        own = f"{low} %" if low == high else f"{low} to {high} %"
        names = ", ".join(one["cause"] for one in alike)
        yield wrapped(f"{'cannot tell':<{_LABEL}} the zero from {names} ({own} of its own)")


def _gain(result: diagnosis.DiagnosisResult, folder: Path | None) -> Lines:
    """Yield what the extended model gains, the next run, and what would have been seen."""
    before, after = result.simulated.heldout_rms_nm, result.extended.heldout_rms_nm
    if before is not None and after is not None:
        yield from _labelled(
            "held-out", f"{before:.4g} N m rms simulated, {after:.4g} N m rms extended"
        )
    yield from _labelled("rest", rest_line(result))
    gain = result.filter_gain
    if gain is not None:
        rms = gain.error_rms_nm
        sizes = [
            f"order {block.order:.6g}: {block.amplitude_nm.before:.3g} -> "
            f"{block.amplitude_nm.after:.3g} N m"
            for block in gain.blocks
        ]
        error = f"error {rms.before:.3g} -> {rms.after:.3g} N m rms"
        yield from _labelled("filter", f"with new blocks {', '.join(sizes)}; {error}")
    open_run = result.separating_run
    if open_run is not None and open_run.file and folder is not None:
        yield f"{'next':<{_LABEL}}hdbench run-ripple --plan {folder / open_run.file}"
    alone = not result.causes and not result.unexplained
    limits = result.minimum_detectable[: _SHOWN_LIMITS_ALONE if alone else _SHOWN_LIMITS]
    sizes = [f"{limit.name} {limit.amplitude_nm:.2g}" for limit in limits]
    yield from _labelled("limits", f"90 % seen from, N m: {', '.join(sizes)}" if sizes else "")


def _record(one: diagnosis.RecordPart, result: diagnosis.DiagnosisResult) -> str:
    """Say what the extended model makes of a record, or why the record took no part."""
    if one.left_out:
        return f"{one.record} left out: {one.left_out}"
    before, after = one.simulated.heldout_rms_nm, one.extended.heldout_rms_nm
    line = f"{one.record}: held-out {before:.4g} -> {after:.4g} N m rms"
    material = [cause.name for cause in result.causes if cause.name in one.disagrees]
    if material:
        names = ", ".join(dict.fromkeys(material))
        line += f"; disagrees about {names}: another drive, or another state of it?"
    return line


def names_line(result: diagnosis.DiagnosisResult, room: int | None = None) -> str:
    """Say how many names of the catalogue this record can show, and why not the others.

    With a room, in characters, reasons stand with counts instead of names, as many as fit.
    """
    names = result.testable
    hidden = hidden_names(result)
    count = sum(len(group) for group in hidden.values())
    told = f"{len(names) - count} of {len(names)} names" if names else ""
    if room is None and names:
        told += " can be tested here"
    lead, shown = "; not: ", 0
    for reason, group in hidden.items():
        words = _few(group) if room is None else str(len(group))
        longer = f"{told}{lead}{words} ({reason})"
        if len(longer) > (_NAMES_ROOM if room is None else room - len("; 99 more")):
            break
        told, lead, shown = longer, "; ", shown + len(group)
    return told if shown == count else f"{told}{lead}{count - shown} more"


def _few(names: list[str]) -> str:
    """Return the first names and how many follow."""
    if len(names) <= _SHOWN_NAMES + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_SHOWN_NAMES])} and {len(names) - _SHOWN_NAMES} more"
