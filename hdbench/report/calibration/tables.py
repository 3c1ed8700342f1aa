"""Tables of the calibration record, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from hdbench.report.numbers import (
    DASH,
    MINUS,
    NBSP,
    declared,
    fixed,
    millivolts,
    percent,
    ppm,
    rounded_with,
    short,
    two_digits,
    with_std,
)
from hdbench.report.pagemodel import Column, Table
from hdbench.report.texts import page_text
from hdbench.results import CalibrationResult
from hdbench.results import calibration as record

# probability by chance below which a difference is told; its size is told with it
_CHANCE = 0.05
_ITEM = {
    "laboratory": "calibrated by",
    "place": "place",
    "customer": "for",
    "operator": "operator",
    "drive_serial": "drive",
    "flexspline_serial": "flexspline",
    "gear_ratio": "gear ratio",
    "rated_torque_nm": "rated torque (N·m)",
    "bridge_ohm": "bridge resistance (Ω)",
    "gauge_factor": "gauge factor",
    "cable": "cable and wiring",
    "amplifier_serial": "amplifier",
    "amplifier_gain": "amplifier gain (V/V)",
    "excitation_v": "excitation (V)",
}


def tables(result: CalibrationResult) -> tuple[Table, ...]:
    """List everything that a calibration record holds."""
    made: list[Table] = []
    if result.identity and result.standards and result.torque:
        made += [_identity(result.identity), _standards(result.standards, result.torque)]
    if result.uncertainty:
        made += [_gain(result, result.uncertainty), _spread(result), _equations(result)]
        made.append(_classes(result))
    if result.acceptance:
        made.append(_acceptance(result.acceptance))
    made.append(_budget(result))
    if result.torque:
        made.append(_corrections(result.torque, result.side_force))
    made = [*Table.filled(*made), _experiments(result)]
    made += [_steps(result, group) for group in result.groups]
    if result.readings:
        made += Table.filled(
            _environment(result), _shunt(result), _warnings(result), _readings(result)
        )
        made.append(_signatures(result))
    return tuple(made)


def _identity(item: record.IdentityRecord) -> Table:
    rows = tuple((words, declared(getattr(item, key))) for key, words in _ITEM.items())
    return Table("What was calibrated", ("", ""), rows, page_text("item_note"))


def _standards(standards: record.StandardsRecord, account: record.AppliedTorqueAccount) -> Table:
    mass, length = standards.mass, standards.length
    meter, torque = standards.instrument, standards.torque
    grade = f"class {mass.accuracy_class}" if mass.accuracy_class else ""
    if mass.relative_half_width is not None:
        grade = f"{grade} ±{1e6 * mass.relative_half_width:.3g} ppm".strip()
    half = length.half_width_m
    size = "not declared" if half is None else f"±{1e3 * half:.3g} mm"
    rows = (
        ("mass", grade or "not declared", declared(mass.certificate)),
        ("length", size, declared(length.certificate)),
        ("gravity", f"{account.gravity_m_s2:.6f} m/s²", str(account.gravity_source)),
        ("instrument", _expanded(meter), declared(meter.certificate)),
        ("instrument, type and serial", declared(meter.identity), ""),
        ("reference torque sensor", _expanded(torque), declared(torque.certificate)),
    )
    return Table("Standards", ("standard", "uncertainty", "certificate or source"), rows)


def _expanded(standard: record.TorqueRecord) -> str:
    size = standard.relative_expanded_uncertainty
    return "not declared" if size is None else f"U = {1e6 * size:.3g} ppm (k = 2)"


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
    columns: tuple[Column, ...] = (
        ("gain", lambda row: names[row[0]]),
        ("value (N·m/V)", lambda row: rounded_with(row[1].value, row[1].expanded)[0]),
        ("U (N·m/V)", lambda row: two_digits(row[1].expanded)),
        ("U (%)", lambda row: percent(row[1].expanded_relative, 2)),
        ("k", lambda row: fixed(row[1].coverage_factor, 2)),
        ("degrees of freedom", lambda row: _degrees(row[1].dof)),
    )
    gains = ((key, getattr(uncertainty, key)) for key in names)
    rows = [(key, gain) for key, gain in gains if gain is not None]
    return Table.of("Gain and its uncertainty", columns, rows, note)


def _degrees(dof: float | None, none: str = DASH) -> str:
    return none if dof is None else f"{dof:.3g}"


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

    columns: tuple[Column, ...] = (
        ("group", lambda g: f"{g.direction}, {g.range}"),
        ("volts of torque", lambda g: line("V", turn / gain(g), "T")),
        ("torque of volts", lambda g: line("T", turn * gain(g), "V")),
        ("cubic", cubic),
        ("range (N·m)", lambda g: f"0 to {g.largest_torque_nm:.4g}"),
    )
    groups = [g for g in result.groups if gain(g) is not None]
    return Table.of("Equation both ways", columns, groups, page_text("equation_note"))


def _classes(result: CalibrationResult) -> Table:
    def size(key: str) -> Any:
        return lambda row: (
            f"{getattr(row[2], key):.0f} steps"
            if row[2].name == "resolution"
            else f"{percent(getattr(row[2], key))}{NBSP}%"
        )

    columns: tuple[Column, ...] = (
        ("group", lambda row: row[0]),
        ("criterion", lambda row: row[1]),
        ("largest", size("value")),
        ("limit of the class", size("limit")),
        ("class", lambda row: "none" if row[2].allowed is None else f"{row[2].allowed:g}"),
    )
    note = f"{result.class_reason}."
    if result.grade is not None:
        note = f"Overall: class {result.grade:g}, indicative. {note}"
    rows = [row for group in result.groups for row in _criteria(group)]
    title = "Indicative class, in the manner of EURAMET cg-14"
    return Table.of(title, columns, rows, note)


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


def _acceptance(acceptance: record.Acceptance) -> Table:
    words = {True: "yes", False: "no", None: "not testable"}
    columns: tuple[Column, ...] = (
        ("what", "name"),
        ("value", "value"),
        ("upper end of its 95 % interval", "upper"),
        ("limit", "limit"),
        ("held", "passed", words.__getitem__),
    )
    note = f"Decision rule: {acceptance.statement}."
    return Table.of("Acceptance", columns, acceptance.tests, note)


def _budget(result: CalibrationResult) -> Table:
    def known(key: str, form: Any = short) -> Any:
        return lambda row: form(getattr(row, key)) if row.declared else DASH

    columns: tuple[Column, ...] = (
        ("source", "name"),
        ("half width or u", "half_width", lambda x: declared(None if x is None else float(x))),
        ("unit", "unit"),
        ("distribution", known("distribution", str)),
        ("divisor", known("divisor", partial(fixed, digits=3))),
        ("sensitivity", known("sensitivity")),
        ("u of the gain (ppm)", known("relative_std", ppm)),
        ("dof", "dof", partial(_degrees, none="∞")),
        ("share (%)", known("share", partial(percent, digits=1))),
        ("certificate or origin", "origin"),
    )
    return Table.of(
        "Uncertainty budget of the gain", columns, result.budget, page_text("budget_note")
    )


def _corrections(torque: record.AppliedTorqueAccount, force: record.SideForce | None) -> Table:
    note = ""
    rows: list[tuple[str, ...]] = [
        (
            c.name,
            fixed(1e6 * c.relative, 1) if c.made else "not made",
            percent(c.uncertainty_share, 1),
            c.detail,
        )
        for c in torque.corrections
    ]
    if force is not None:
        half, bending = force.half_direction_difference, force.bending_nm
        size = "not known" if half is None else f"at most {ppm(half)}"
        moment = "" if bending is None else f", bending moment {bending:.3g} N·m"
        reason = f"{force.force_n:.4g} N{moment}; {force.reason}"
        rows.append(("side force", size, DASH, reason))
    if torque.largest_nm is not None:
        sizes = {"nominal": torque.largest_nominal_nm, "corrected": torque.largest_nm}
        note = page_text("torque_note", std=ppm(torque.relative_std), **sizes)
    head = ("correction", "size (ppm)", "share of the torque's variance (%)", "with")
    return Table("Applied torque, correction by correction", head, tuple(rows), note)


def _experiments(result: CalibrationResult) -> Table:
    def sure(value: float, std: float | None) -> str:
        return with_std({"value": value, "std": std})

    columns: tuple[Column, ...] = (
        ("experiment", "id"),
        ("position (rad)", "position_rad"),
        ("direction", "direction"),
        ("range", "range"),
        ("gain (N·m/V)", lambda line: sure(line.gain_nm_per_v, line.gain_std_nm_per_v)),
        ("intercept (N·m)", lambda line: sure(line.intercept_nm, line.intercept_std_nm)),
        ("residual rms (mN·m)", lambda line: f"{1e3 * line.residual_rms_nm:.2f}"),
        ("readings", "n"),
    )
    reason = str(result.gain_basis_reason)
    note = f"The uncertainty of the mean gain rests on: {reason}." if reason else ""
    title = "Experiments, by the report's method"
    return Table.of(title, columns, result.experiments, note)


def _steps(result: CalibrationResult, group: record.LoadGroup) -> Table:
    """Return the evaluation step by step of one group."""

    def best(key: str, form: Any = percent) -> Any:
        return lambda step: form(getattr(step.increasing_decreasing or step.increasing, key, None))

    def off(step: record.LoadStep) -> str:
        line = step.deviation_up_down_relative
        return percent(step.deviation_linear_relative if line is None else line)

    both = "increasing_decreasing"
    columns: tuple[Column, ...] = (
        ("T (N·m)", "torque_nm", partial(fixed, digits=4)),
        ("Y (mV)", "deflection_v", millivolts),
        ("line (mV)", "fitted_v", millivolts),
        ("b' (%)", "repeatability_relative", percent),
        ("b (%)", "reproducibility_relative", percent),
        ("h (%)", "reversibility_relative", percent),
        ("fa (%)", off),
        ("w (%)", best("relative_std")),
        ("k from dof", best("coverage_factor", partial(fixed, digits=2))),
        ("W I, k = 2 (%)", "increasing.expanded_relative_k2", percent),
        ("W I (%)", "increasing.expanded_relative", percent),
        ("W II, k = 2 (%)", f"{both}.expanded_relative_k2_with_deviation", percent),
        ("W II (%)", f"{both}.expanded_relative_with_deviation", percent),
        ("U (N·m)", best("expanded_nm", two_digits)),
    )
    zero, counts = percent(group.zero_relative), {"series": group.n_series, "method": result.method}
    note = page_text("step_note", positions=group.n_positions, zero=zero, **counts)
    title = f"Evaluation step by step: {_group_words(group)}"
    return Table.of(title, columns, steps_of(result, group), note)


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


def _environment(result: CalibrationResult) -> Table:
    rows: list[tuple[str, ...]] = []
    for key, words in (
        ("temperature_c", "temperature (°C)"),
        ("humidity_percent", "relative humidity (%)"),
        ("pressure_hpa", "air pressure (hPa)"),
    ):
        ends = getattr(result.course, key)
        if ends is None:
            rows.append((words, "not told", "not told", DASH))
        else:
            sizes = (ends.first, ends.last, ends.largest - ends.least)
            rows.append((words, *(fixed(size, 2) for size in sizes)))
    head = ("", "at the first reading", "at the last", "largest less least")
    return Table("Environment", head, tuple(rows))


def _shunt(result: CalibrationResult) -> Table:
    shunt = result.shunt
    if shunt is None:
        return Table("Shunt check", (), ())
    words = {True: "within the tolerance", False: "outside the tolerance", None: "not compared"}
    change = words[shunt.within]
    if shunt.change is not None:
        limit = "" if shunt.tolerance is None else f" of {percent(shunt.tolerance)} %"
        change = f"{percent(shunt.change)} %, {change}{limit}"
    rows = (
        ("resistor (Ω)", fixed(shunt.resistor_ohm, 0)),
        ("reading with less without (V)", fixed(shunt.reading_v, 4)),
        ("at the last calibration (V)", declared(shunt.expected_v)),
        ("change", change),
        ("torque equivalent (N·m)", fixed(shunt.torque_equivalent_nm, 3)),
    )
    note = "The shunt checks amplifier, excitation and wiring, not the transducer."
    return Table("Shunt check", ("", ""), rows, note)


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


def _readings(result: CalibrationResult) -> Table:
    def reading(r: record.ReadingRecord) -> str:
        volts = r.reading_v
        return short(volts, (r.reading_std_v or 0.0) / 10.0 or 1e-4 * abs(volts))

    def series(r: record.ReadingRecord) -> str:
        return str(r.series) + ("" if r.kind == "reading" else f" ({r.kind})")

    columns: tuple[Column, ...] = (
        ("experiment", "experiment"),
        ("series", series),
        ("torque (N·m)", "torque_nm", partial(fixed, digits=4)),
        ("mass (kg)", "mass_kg", lambda mass: DASH if mass is None else f"{mass:g}"),
        ("reading (V)", reading),
        ("s (mV)", "reading_std_v", millivolts),
        ("samples", "n_samples"),
        ("time (s)", "time_s", partial(fixed, digits=1)),
        ("temperature (°C)", "temperature_c", partial(fixed, digits=2)),
        ("marks", "flags", ", ".join),
    )
    return Table.of("Readings", columns, result.readings)


def _signatures(result: CalibrationResult) -> Table:
    days = result.validity_days
    operator = result.identity.operator if result.identity else ""
    until = (
        DASH if days is None else f"runs refuse it after {days:g} days, except with --allow-expired"
    )
    rows = (
        ("calibrated by (name, date, signature)", operator),
        ("checked by (name, date, signature)", ""),
        ("validity", until),
    )
    return Table("Signatures", ("", ""), rows, "End of the calibration record.")
