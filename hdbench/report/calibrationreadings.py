"""Tables of the calibration record: environment, warnings, readings, signatures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.calibrationwords import declared, fixed, group_words, percent, volts
from hdbench.report.elements import Table
from hdbench.report.numbers import DASH, short

__all__ = ["course_tables"]

Result = Mapping[str, Any]
# probability by chance below which a difference is told; its size is told with it
_CHANCE = 0.05


def course_tables(result: Result) -> tuple[Table, ...]:
    """Return environment, readings, warnings and the place for signatures."""
    if "course" not in result:
        return ()
    made = (_environment(result), _shunt(result), _warnings(result), _readings(result))
    return (*(table for table in made if table.rows), _signatures(result))


def _environment(result: Result) -> Table:
    course = result["course"]
    names = (
        ("temperature_c", "temperature (°C)"),
        ("humidity_percent", "relative humidity (%)"),
        ("pressure_hpa", "air pressure (hPa)"),
    )
    rows = []
    for key, words in names:
        ends = course[key]
        told = ["not told"] * 2 if ends is None else [fixed(ends[k], 2) for k in ("first", "last")]
        span = DASH if ends is None else fixed(ends["largest"] - ends["least"], 2)
        rows.append((words, *told, span))
    head = ("", "at the first reading", "at the last", "largest less least")
    return Table("Environment", head, tuple(rows))


def _shunt(result: Result) -> Table:
    body = result.get("shunt")
    if body is None:
        return Table("Shunt check", (), ())
    words = {True: "within the tolerance", False: "outside the tolerance", None: "not compared"}
    change = words[body["within"]]
    if body["change"] is not None:
        limit = "" if body["tolerance"] is None else f" of {percent(body['tolerance'])} %"
        change = f"{percent(body['change'])} %, {change}{limit}"
    rows = (
        ("resistor (Ω)", fixed(body["resistor_ohm"], 0)),
        ("reading with less without (V)", fixed(body["reading_v"], 4)),
        ("at the last calibration (V)", declared(body["expected_v"])),
        ("change", change),
        ("torque equivalent (N·m)", fixed(body["torque_equivalent_nm"], 3)),
    )
    note = "The shunt checks amplifier, excitation and wiring, not the transducer."
    return Table("Shunt check", ("", ""), rows, note)


def _warnings(result: Result) -> Table:
    rows = [("departs from the guide's sequence", text) for text in result["deviations"]]
    rows += _significant(result)
    for odd in result["outliers"]:
        size = f"{odd['statistic']:.2f} standard deviations off, limit {odd['limit']:.2f}"
        where = f"experiment {odd['experiment']}"
        if odd["kind"] == "reading":
            where += f", {odd['series']}, {odd['torque_nm']:.4g} N·m"
        rows.append((f"{odd['kind']} stands off, kept", f"{where}: {size}"))
    rows += [(note["name"].replace("-", " "), note["detail"]) for note in result.get("flags", ())]
    rows += [(note["name"].replace("-", " "), note["detail"]) for note in result.get("notes", ())]
    times = result["course"]["excluded_at_s"]
    if times:
        shown = ", ".join(f"{t:.2f}" for t in times[:20])
        rows.append(("samples left out of averages", f"{len(times)}, at {shown} s"))
    undeclared = result["torque"]["not_declared"]
    if undeclared:
        rows.append(("not declared, so without uncertainty", ", ".join(undeclared)))
    return Table("Warnings", ("what", "in words"), tuple(rows))


def _significant(result: Result) -> list[tuple[str, str]]:
    """Return differences and curvature that chance does not explain, with their size."""
    rows = []
    for key, words in (("direction", "directions differ"), ("ranges", "ranges differ")):
        body = result.get(key)
        if body is not None and body["probability"] is not None and body["probability"] < _CHANCE:
            size = percent(body["relative"]["value"])
            rows.append(
                (
                    words,
                    f"{body['first']} less {body['second']}: {size} % of the gain, "
                    f"probability by chance {body['probability']:.2g}",
                )
            )
    for group in result["groups"]:
        lack = group["lack_of_fit"]
        if lack is not None and lack["probability"] is not None and lack["probability"] < _CHANCE:
            rows.append(
                (
                    "not a straight line",
                    f"{group_words(group)}: {percent(lack['relative'])} % of "
                    f"the largest deflection, probability by chance {lack['probability']:.2g}",
                )
            )
    return rows


def _readings(result: Result) -> Table:
    rows = tuple(
        (
            r["experiment"],
            r["series"] if r["kind"] == "reading" else f"{r['series']} ({r['kind']})",
            fixed(r["torque_nm"], 4),
            DASH if r["mass_kg"] is None else f"{r['mass_kg']:g}",
            short(r["reading_v"], (r["reading_std_v"] or 0.0) / 10.0 or 1e-4 * abs(r["reading_v"])),
            volts(r["reading_std_v"]),
            DASH if r["n_samples"] is None else str(r["n_samples"]),
            fixed(r["time_s"], 1),
            fixed(r["temperature_c"], 2),
            ", ".join(r["flags"]),
        )
        for r in result["readings"]
    )
    head = (
        "experiment",
        "series",
        "torque (N·m)",
        "mass (kg)",
        "reading (V)",
        "s (mV)",
        "samples",
        "time (s)",
        "temperature (°C)",
        "marks",
    )
    return Table("Readings", head, rows)


def _signatures(result: Result) -> Table:
    item = result.get("identity") or {}
    days = result.get("validity_days")
    until = DASH if days is None else f"runs refuse it after {days:g} days unless told otherwise"
    rows = (
        ("calibrated by (name, date, signature)", item.get("operator") or ""),
        ("checked by (name, date, signature)", ""),
        ("validity", until),
    )
    return Table("Signatures", ("", ""), rows, "End of the calibration record.")
