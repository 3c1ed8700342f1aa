"""Tables of the calibration record, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from hdbench.report.numbers import DASH, MINUS, NBSP, percent, ppm, short
from hdbench.report.pagemodel import Table
from hdbench.report.texts import page_text
from hdbench.results import CalibrationResult
from hdbench.results import calibration as record

# probability by chance below which a difference is told; its size is told with it
_CHANCE = 0.05
_ENVIRONMENT = {
    "temperature_c": "temperature (°C)",
    "humidity_percent": "relative humidity (%)",
    "pressure_hpa": "air pressure (hPa)",
}


def tables(result: CalibrationResult) -> tuple[Table, ...]:
    """List everything that a calibration record holds."""
    made: list[Table] = []
    if result.identity and result.standards and result.torque:
        made.append(Table.told("identity", item=result.identity))
        made.append(_standards(result.standards, result.torque))
    if result.uncertainty:
        made += [_gain(result, result.uncertainty), _spread(result), _equations(result)]
        made.append(_classes(result))
    if result.acceptance:
        tests, statement = result.acceptance.tests, result.acceptance.statement
        made.append(Table.told("acceptance", tests, statement=statement))
    made.append(Table.told("budget", result.budget))
    if result.torque:
        made.append(_corrections(result.torque, result.side_force))
    made = [*Table.filled(*made), _experiments(result)]
    for group in result.groups:
        told: Any = {"result": result, "group": group, "zero": percent(group.zero_relative)}
        words = _group_words(group)
        made.append(Table.told("steps", steps_of(result, group), words=words, **told))
    if result.readings:
        environment = [(words, getattr(result.course, key)) for key, words in _ENVIRONMENT.items()]
        made.append(Table.told("environment", environment))
        if result.shunt:
            made.append(_shunt(result.shunt))
        made += Table.filled(_warnings(result))
        made.append(Table.told("readings", result.readings, reading=_reading))
        made.append(Table.told("signatures", result=result))
    return tuple(made)


def _standards(standards: record.StandardsRecord, account: record.AppliedTorqueAccount) -> Table:
    mass, half = standards.mass, standards.length.half_width_m
    grade = f"class {mass.accuracy_class}" if mass.accuracy_class else ""
    if mass.relative_half_width is not None:
        grade = f"{grade} ±{1e6 * mass.relative_half_width:.3g} ppm".strip()
    length = None if half is None else f"±{1e3 * half:.3g} mm"
    told: Any = {"standards": standards, "account": account, "mass": grade, "length": length}
    return Table.told("standards", expanded=_expanded, **told)


def _expanded(standard: record.TorqueRecord) -> str | None:
    size = standard.relative_expanded_uncertainty
    return None if size is None else f"U = {1e6 * size:.3g} ppm (k = 2)"


def _gain(result: CalibrationResult, uncertainty: record.GainUncertainty) -> Table:
    one = result.gain_basis in ("residual", "repetitions")
    names = {
        "mean_of_positions": "this one position" if one else "mean of positions",
        "any_one_position": "any one position",
        "naive": "as if all experiments were independent (for comparison only)",
    }
    mean, trial, note = uncertainty.mean_of_positions, result.monte_carlo, ""
    if mean is not None:
        free = "" if mean.dof is None else f" (from {mean.dof:.3g} effective degrees of freedom)"
        note = page_text("gain_note", k=mean.coverage_factor, free=free)
    if trial is not None:
        ends = " to ".join(short(x, trial.expanded_nm_per_v / 2) for x in trial.interval_nm_per_v)
        word = "agree" if trial.agrees_with_formula else "do not agree"
        size, draws = short(trial.tolerance_nm_per_v), {"draws": trial.draws, "seed": trial.seed}
        note += " " + page_text("trial_note", ends=ends, word=word, tolerance=size, **draws)
    gains = [(words, getattr(uncertainty, key)) for key, words in names.items()]
    return Table.told("gain", [row for row in gains if row[1] is not None], note)


def _spread(result: CalibrationResult) -> Table:
    rows: list[tuple[str, str, str]] = []
    interval, places = result.consistency_interval, result.positions
    if result.consistency is not None and interval:
        words = f"consistency of {result.n_experiments} gains, s/mean"
        ends = f"95 %: {percent(interval[0], 2)} to {percent(interval[1], 2)} %"
        rows.append((words, f"{percent(result.consistency)} %", ends))
    if places is not None:
        mean = abs(float(result.gain_nm_per_v.value))
        rows += [
            (words, f"{percent(size / mean)} %", f"{size:.4g} N·m/V")
            for size, words in (
                (places.repeatability_nm_per_v, "repeatability (within a position)"),
                (places.between_positions_nm_per_v, "spread between positions"),
                (places.reproducibility_nm_per_v, "reproducibility (any one experiment)"),
            )
        ]
    for key, words in (("direction", "direction"), ("ranges", "range")):
        pairs = getattr(result, key)
        if pairs is not None:
            chance = DASH if pairs.probability is None else f"{pairs.probability:.2g}"
            size = pairs.relative
            rows.append(
                (
                    f"{words}: {pairs.first} less {pairs.second}",
                    f"{percent(size.value)} ± {percent(size.std)} %",
                    f"{pairs.n_pairs} pairs; probability without a difference: {chance}",
                )
            )
    between = result.consensus
    if between is not None:
        rows.append(
            (
                "scatter over what the lines' own uncertainties explain (Birge ratio)",
                f"{between.birge_ratio:.3g}",
                "above 1.4 the lines' own uncertainties do not explain the scatter",
            )
        )
    effects, note = result.direction_effects, ""
    if effects and effects.group:
        note = f"{' and '.join(effects.group)} are one group here: {effects.reason}."
    return Table("Consistency and spread", ("what", "size", "more"), tuple(rows), note)


def _equations(result: CalibrationResult) -> Table:
    # deflections are kept positive with the load; a bridge wired the other way has the sign
    turn = -1.0 if float(result.gain_nm_per_v.value) < 0.0 else 1.0

    def gain(group: record.LoadGroup) -> Any:
        return group.gain_up_down_nm_per_v or group.gain_up_nm_per_v

    def line(left: str, slope: float, right: str) -> str:
        return f"{left} = {slope:.6g} {right}".replace("-", MINUS).replace(" ", NBSP)

    def cubic(group: record.LoadGroup) -> str:
        if group.cubic_v is None:
            return DASH
        a, b, c = (turn * float(x) for x in group.cubic_v)
        return f"V = {a:.6g} T {b:+.3g} T² {c:+.3g} T³".replace("-", MINUS)

    groups = [g for g in result.groups if gain(g) is not None]
    return Table.told("equations", groups, turn=turn, gain=gain, line=line, cubic=cubic)


def _classes(result: CalibrationResult) -> Table:
    def size(criterion: record.Criterion, value: float) -> str:
        return (
            f"{value:.0f} steps" if criterion.name == "resolution" else f"{percent(value)}{NBSP}%"
        )

    note = f"{result.class_reason}."
    if result.grade is not None:
        note = f"Overall: class {result.grade:g}, indicative. {note}"
    rows = [row for group in result.groups for row in _criteria(group)]
    return Table.told("classes", rows, note, size=size)


def _criteria(group: record.LoadGroup) -> Iterator[tuple[str, str, record.Criterion]]:
    """Yield every criterion once: loading and unloading differ from loading alone by their fit."""
    name = f"{group.direction}, {group.range}"
    up, both = (
        getattr(group, key).criteria for key in ("class_increasing", "class_increasing_decreasing")
    )
    known = {c.name for c in both}
    for one in (*both, *(c for c in up if c.name not in known)):
        if one.name != "fit":
            yield name, one.name, one
    for words, some in (("loading, cubic", up), ("loading and unloading, line", both)):
        for one in some:
            if one.name == "fit":
                yield name, f"fit, {words}", one


def _corrections(torque: record.AppliedTorqueAccount, force: record.SideForce | None) -> Table:
    table, note = Table.told("corrections", torque.corrections), ""
    rows = list(table.rows)
    if force is not None:
        half, bending = force.half_direction_difference, force.bending_nm
        size = "not known" if half is None else f"at most {ppm(half)}"
        moment = "" if bending is None else f", bending moment {bending:.3g} N·m"
        reason = f"{force.force_n:.4g} N{moment}; {force.reason}"
        rows.append(("side force", size, DASH, reason))
    if torque.largest_nm is not None:
        sizes = {"nominal": torque.largest_nominal_nm, "corrected": torque.largest_nm}
        note = page_text("torque_note", std=ppm(torque.relative_std), **sizes)
    return replace(table, rows=tuple(rows), note=note)


def _experiments(result: CalibrationResult) -> Table:
    reason = str(result.gain_basis_reason)
    note = f"The uncertainty of the mean gain rests on: {reason}." if reason else ""
    return Table.told("experiments", result.experiments, note)


def steps_of(result: CalibrationResult, group: record.LoadGroup) -> list[record.LoadStep]:
    """Return the steps of a group of series."""
    names = ("direction", "range", "loading", "arm_length_m")
    own = [getattr(group, name) for name in names]
    return [step for step in result.steps if [getattr(step, name) for name in names] == own]


def _group_words(group: record.LoadGroup) -> str:
    """Return what tells a group from the others, in words."""
    turn = {"cw": "clockwise", "ccw": "anticlockwise"}[str(group.direction)]
    words = f"{turn}, {group.range} range"
    if group.loading == "couple":
        words += ", couple"
    if group.arm_length_m is not None:
        words += f", arm {group.arm_length_m:g} m"
    return words


def _shunt(shunt: record.ShuntRecord) -> Table:
    words = {True: "within the tolerance", False: "outside the tolerance", None: "not compared"}
    change = words[shunt.within]
    if shunt.change is not None:
        limit = "" if shunt.tolerance is None else f" of {percent(shunt.tolerance)} %"
        change = f"{percent(shunt.change)} %, {change}{limit}"
    return Table.told("shunt", shunt=shunt, change=change)


def _warnings(result: CalibrationResult) -> Table:
    rows = [("departs from the guide's sequence", text) for text in result.deviations]
    rows += _significant(result)
    for odd in result.outliers:
        where = f"experiment {odd.experiment}"
        if odd.kind == "reading":
            where += f", {odd.series}, {odd.torque_nm:.4g} N·m"
        size = f"{odd.statistic:.2f} standard deviations off, limit {odd.limit:.2f}"
        rows.append((f"{odd.kind} stands off, kept", f"{where}: {size}"))
    for note in (*result.flags, *result.notes):
        rows.append((note.name.replace("-", " "), note.detail))
    times = result.course.excluded_at_s
    if times:
        shown = ", ".join(f"{t:.2f}" for t in times[:20])
        rows.append(("samples left out of averages", f"{len(times)}, at {shown} s"))
    undeclared = result.torque.not_declared if result.torque else ()
    if undeclared:
        rows.append(("not declared, so without uncertainty", ", ".join(undeclared)))
    return Table("Warnings", ("what", "in words"), tuple(rows))


def _significant(result: CalibrationResult) -> Iterator[tuple[str, str]]:
    """Yield differences and curvature that chance does not explain, with their size."""
    for key, words in (("direction", "directions differ"), ("ranges", "ranges differ")):
        pairs = getattr(result, key)
        if pairs is not None and _unlikely(pairs.probability):
            yield (
                words,
                f"{pairs.first} less {pairs.second}: {percent(pairs.relative.value)} % "
                f"of the gain, probability by chance {pairs.probability:.2g}",
            )
    for group in result.groups:
        lack = group.lack_of_fit
        if lack is not None and _unlikely(lack.probability):
            yield (
                "not a straight line",
                f"{_group_words(group)}: {percent(lack.relative)} % of the largest deflection, "
                f"probability by chance {lack.probability:.2g}",
            )


def _unlikely(probability: float | None) -> bool:
    return probability is not None and probability < _CHANCE


def _reading(r: record.ReadingRecord) -> str:
    volts = r.reading_v
    return short(volts, (r.reading_std_v or 0.0) / 10.0 or 1e-4 * abs(volts))
