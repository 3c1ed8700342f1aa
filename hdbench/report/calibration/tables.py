"""Tables of the calibration record, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from hdbench.report.numbers import (
    DASH,
    MINUS,
    declared,
    fixed,
    millivolts,
    percent,
    ppm,
    rounded_with,
    short,
    two_digits,
    value_of,
    with_std,
)
from hdbench.report.pagemodel import Column, Table, filled, make_table

__all__ = ["STEP_GROUP", "record_tables"]

Result = Mapping[str, Any]
# what tells a group of series from the others
STEP_GROUP = ("direction", "range", "loading", "arm_length_m")
_STATEMENT = (
    "Unaccredited; traceability as declared by the operator. The results relate only to the item "
    "described, as it was when it was calibrated. Not to be reproduced except in full."
)
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


def record_tables(result: Result) -> tuple[Table, ...]:
    """List everything that a calibration record holds."""
    made: list[Table] = []
    if result.get("identity") and result.get("standards"):
        made += [_identity(result), _standards(result)]
    if "uncertainty" in result:
        made += [_gain(result), _spread(result), _equations(result), _classes(result)]
        made += [_acceptance(result), _budget(result), _corrections(result)]
    made = [*filled(*made), _experiments(result)]
    made += [_steps(result, group) for group in result.get("groups", ())]
    if "course" in result:
        made += filled(_environment(result), _shunt(result), _warnings(result), _readings(result))
        made.append(_signatures(result))
    return tuple(made)


def _identity(result: Result) -> Table:
    item = result["identity"]
    rows = tuple((words, declared(item.get(key))) for key, words in _ITEM.items())
    return Table("What was calibrated", ("", ""), rows, _STATEMENT)


def _standards(result: Result) -> Table:
    mass, length, meter, torque = (
        result["standards"][key] for key in ("mass", "length", "instrument", "torque")
    )
    account = result["torque"]
    grade = f"class {mass['accuracy_class']}" if mass["accuracy_class"] else ""
    if mass["relative_half_width"] is not None:
        grade = f"{grade} ±{1e6 * mass['relative_half_width']:.3g} ppm".strip()
    half = length["half_width_m"]
    size = "not declared" if half is None else f"±{1e3 * half:.3g} mm"
    rows = (
        ("mass", grade or "not declared", declared(mass["certificate"])),
        ("length", size, declared(length["certificate"])),
        ("gravity", f"{account['gravity_m_s2']:.6f} m/s²", str(account["gravity_source"])),
        ("instrument", _expanded(meter), declared(meter["certificate"])),
        ("instrument, type and serial", declared(meter["identity"]), ""),
        ("reference torque sensor", _expanded(torque), declared(torque["certificate"])),
    )
    return Table("Standards", ("standard", "uncertainty", "certificate or source"), rows)


def _expanded(standard: Result) -> str:
    size = standard["relative_expanded_uncertainty"]
    return "not declared" if size is None else f"U = {1e6 * size:.3g} ppm (k = 2)"


def _gain(result: Result) -> Table:
    one = result.get("gain_basis") in ("residual", "repetitions")
    names = {
        "mean_of_positions": "this one position" if one else "mean of positions",
        "any_one_position": "any one position",
        "naive": "as if all experiments were independent (for comparison only)",
    }
    mean = result["uncertainty"]["mean_of_positions"]
    free = "" if mean["dof"] is None else f" (from {mean['dof']:.3g} effective degrees of freedom)"
    note = (
        "The expanded uncertainty is the standard uncertainty multiplied by "
        f"k = {mean['coverage_factor']:.2f}{free} such that the coverage probability is about 95 %."
    )
    trial = result.get("monte_carlo")
    if trial is not None:
        ends = (short(x, trial["expanded_nm_per_v"] / 2) for x in trial["interval_nm_per_v"])
        word = "agree" if trial["agrees_with_formula"] else "do not agree"
        note += (
            f" Monte Carlo with {trial['draws']} trials (seed {trial['seed']}): 95 % from "
            f"{' to '.join(ends)} N·m/V; its ends {word} with the formula within "
            f"{short(trial['tolerance_nm_per_v'])} N·m/V."
        )
    columns: tuple[Column, ...] = (
        ("gain", lambda row: names[row[0]]),
        ("value (N·m/V)", lambda row: rounded_with(row[1]["value"], row[1]["expanded"])[0]),
        ("U (N·m/V)", lambda row: rounded_with(row[1]["value"], row[1]["expanded"])[1]),
        ("U (%)", lambda row: percent(row[1]["expanded_relative"], 2)),
        ("k", lambda row: fixed(row[1]["coverage_factor"], 2)),
        ("degrees of freedom", lambda row: row[1]["dof"], _degrees),
    )
    told = ((key, result["uncertainty"].get(key)) for key in names)
    rows = [(key, body) for key, body in told if body is not None]
    return make_table("Gain and its uncertainty", columns, rows, note)


def _degrees(dof: float | None, none: str = DASH) -> str:
    return none if dof is None else f"{dof:.3g}"


def _spread(result: Result) -> Table:
    rows: list[tuple[str, str, str]] = []
    interval, places = result.get("consistency_interval"), result.get("positions")
    if result.get("consistency") is not None and interval:
        words = f"consistency of {result['n_experiments']} gains, s/mean"
        ends = f"95 %: {percent(interval[0], 2)} to {percent(interval[1], 2)} %"
        rows.append((words, f"{percent(result['consistency'])} %", ends))
    if places is not None:
        mean = abs(float(result["gain_nm_per_v"]["value"]))
        rows += [
            (words, f"{percent(places[key] / mean)} %", f"{places[key]:.4g} N·m/V")
            for key, words in (
                ("repeatability_nm_per_v", "repeatability (within a position)"),
                ("between_positions_nm_per_v", "spread between positions"),
                ("reproducibility_nm_per_v", "reproducibility (any one experiment)"),
            )
        ]
    for key, words in (("direction", "direction"), ("ranges", "range")):
        pairs = result.get(key)
        if pairs is not None:
            chance = DASH if pairs["probability"] is None else f"{pairs['probability']:.2g}"
            size = pairs["relative"]
            rows.append(
                (
                    f"{words}: {pairs['first']} less {pairs['second']}",
                    f"{percent(size['value'])} ± {percent(size['std'])} %",
                    f"{pairs['n_pairs']} pairs; probability without a difference: {chance}",
                )
            )
    between = result.get("consensus")
    if between is not None:
        rows.append(
            (
                "scatter over what the lines' own uncertainties explain (Birge ratio)",
                f"{between['birge_ratio']:.3g}",
                "above 1.4 the lines' own uncertainties do not explain the scatter",
            )
        )
    effects, note = result["direction_effects"], ""
    if effects["group"]:
        note = f"{' and '.join(effects['group'])} are one group here: {effects['reason']}."
    return Table("Consistency and spread", ("what", "size", "more"), tuple(rows), note)


def _equations(result: Result) -> Table:
    # deflections are kept positive with the load; a bridge wired the other way has the sign
    turn = -1.0 if float(result["gain_nm_per_v"]["value"]) < 0.0 else 1.0

    def gain(group: Result) -> Any:
        return group["gain_up_down_nm_per_v"] or group["gain_up_nm_per_v"]

    def cubic(group: Result) -> str:
        if group["cubic_v"] is None:
            return DASH
        a, b, c = (turn * float(x) for x in group["cubic_v"])
        return f"V = {a:.6g} T {b:+.3g} T² {c:+.3g} T³".replace("-", MINUS)

    columns: tuple[Column, ...] = (
        ("group", lambda g: f"{g['direction']}, {g['range']}"),
        ("volts of torque", lambda g: f"V = {turn / gain(g):.6g} T".replace("-", MINUS)),
        ("torque of volts", lambda g: f"T = {turn * gain(g):.6g} V".replace("-", MINUS)),
        ("cubic", cubic),
        ("range (N·m)", lambda g: f"0 to {g['largest_torque_nm']:.4g}"),
    )
    note = (
        "V: reading less the zero before loading, V. T: torque, N·m; for anticlockwise groups both "
        "with their signs turned. Lines through zero, loading and unloading together where both "
        "were measured; the cubic holds for loading and only in its range."
    )
    groups = [g for g in result["groups"] if gain(g) is not None]
    return make_table("Equation both ways", columns, groups, note)


def _classes(result: Result) -> Table:
    def size(key: str) -> Any:
        return lambda row: (
            f"{row[2][key]:.0f} steps"
            if row[2]["name"] == "resolution"
            else f"{percent(row[2][key])} %"
        )

    columns: tuple[Column, ...] = (
        ("group", lambda row: row[0]),
        ("criterion", lambda row: row[1]),
        ("largest", size("value")),
        ("limit of the class", size("limit")),
        ("class", lambda row: "none" if row[2]["class"] is None else f"{row[2]['class']:g}"),
    )
    note = f"{result['class_reason']}."
    if result.get("class") is not None:
        note = f"Overall: class {result['class']:g}, indicative. {note}"
    rows = [row for group in result["groups"] for row in _criteria(group)]
    title = "Indicative class, in the manner of EURAMET cg-14"
    return make_table(title, columns, rows, note)


def _criteria(group: Result) -> Iterator[tuple[str, str, Result]]:
    """Yield every criterion once: loading and unloading differ from loading alone by their fit."""
    name = f"{group['direction']}, {group['range']}"
    up, both = (
        group[key]["criteria"] for key in ("class_increasing", "class_increasing_decreasing")
    )
    known = {c["name"] for c in both}
    for one in (*both, *(c for c in up if c["name"] not in known)):
        if one["name"] != "fit":
            yield name, one["name"], one
    for words, some in (("loading, cubic", up), ("loading and unloading, line", both)):
        for one in some:
            if one["name"] == "fit":
                yield name, f"fit, {words}", one


def _acceptance(result: Result) -> Table:
    words = {True: "yes", False: "no", None: "not testable"}
    columns: tuple[Column, ...] = (
        ("what", "name"),
        ("value", "value"),
        ("upper end of its 95 % interval", "upper"),
        ("limit", "limit"),
        ("held", "passed", words.__getitem__),
    )
    body = result["acceptance"]
    return make_table("Acceptance", columns, body["tests"], f"Decision rule: {body['statement']}.")


def _budget(result: Result) -> Table:
    def known(key: str, form: Any = short) -> Any:
        return lambda row: form(row[key]) if row["declared"] else DASH

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
    note = (
        "Sources of the applied torque scale every reading alike: they are added after averaging "
        "and are not divided by the number of readings. What is not declared counts as nothing."
    )
    return make_table("Uncertainty budget of the gain", columns, result["budget"], note)


def _corrections(result: Result) -> Table:
    torque, force, note = result["torque"], result.get("side_force"), ""
    rows: list[tuple[str, ...]] = [
        (
            c["name"],
            fixed(1e6 * c["relative"], 1) if c["made"] else "not made",
            percent(c["uncertainty_share"], 1),
            c["detail"],
        )
        for c in torque["corrections"]
    ]
    if force is not None:
        half, bending = force["half_direction_difference"], force["bending_nm"]
        size = "not known" if half is None else f"at most {ppm(half)}"
        moment = "" if bending is None else f", bending moment {bending:.3g} N·m"
        reason = f"{force['force_n']:.4g} N{moment}; {force['reason']}"
        rows.append(("side force", size, DASH, reason))
    if torque["largest_nm"] is not None:
        note = (
            f"At the largest load: {torque['largest_nominal_nm']:.5f} N·m by mass, local gravity "
            f"and length; {torque['largest_nm']:.5f} N·m corrected, relative standard uncertainty "
            f"{1e6 * torque['relative_std']:.0f} ppm."
        )
    head = ("correction", "size (ppm)", "share of the torque's variance (%)", "with")
    return Table("Applied torque, correction by correction", head, tuple(rows), note)


def _experiments(result: Result) -> Table:
    def sure(name: str, unit: str) -> Any:
        return lambda line: with_std(
            {"value": value_of(line, f"{name}_{unit}"), "std": line.get(f"{name}_std_{unit}")}
        )

    columns: tuple[Column, ...] = (
        ("experiment", "id"),
        ("position (rad)", "position_rad"),
        ("direction", "direction"),
        ("range", "range"),
        ("gain (N·m/V)", sure("gain", "nm_per_v")),
        ("intercept (N·m)", sure("intercept", "nm")),
        ("residual rms (mN·m)", lambda line: f"{1e3 * line['residual_rms_nm']:.2f}"),
        ("readings", "n"),
    )
    reason = str(result.get("gain_basis_reason", ""))
    note = f"The uncertainty of the mean gain rests on: {reason}." if reason else ""
    title = "Experiments, by the report's method"
    return make_table(title, columns, result.get("experiments", ()), note)


def _steps(result: Result, group: Result) -> Table:
    """Return the evaluation step by step of one group."""

    def up(key: str, form: Any = percent) -> Any:
        return lambda step: form((step["increasing"] or {}).get(key))

    def both(key: str, form: Any = percent) -> Any:
        return lambda step: form((step["increasing_decreasing"] or {}).get(key))

    def best(key: str, form: Any = percent) -> Any:
        return lambda step: form(
            (step["increasing_decreasing"] or step["increasing"] or {}).get(key)
        )

    def off(step: Result) -> str:
        line = step["deviation_up_down_relative"]
        return percent(step["deviation_linear_relative"] if line is None else line)

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
        ("W I, k = 2 (%)", up("expanded_relative_k2")),
        ("W I (%)", up("expanded_relative")),
        ("W II, k = 2 (%)", both("expanded_relative_k2_with_deviation")),
        ("W II (%)", both("expanded_relative_with_deviation")),
        ("U (N·m)", best("expanded_nm", two_digits)),
    )
    note = (
        f"{group['n_positions']} positions, {group['n_series']} series. Y: mean over the "
        "positions. b': repeatability, b: reproducibility (standard deviation), h: "
        "reversibility, fa: deviation from the line through zero. W: relative expanded "
        "uncertainty; I: loading with the cubic, II: loading and unloading with the line, its "
        "deviation added; k = 2 as in the guide, then k from the degrees of freedom. w, k and "
        "U belong to II where unloading was read, else to I. f0 = "
        f"{percent(group['zero_relative'])} %; {result['method']}."
    )
    own = [s for s in result["steps"] if all(s[key] == group[key] for key in STEP_GROUP)]
    return make_table(f"Evaluation step by step: {_group_words(group)}", columns, own, note)


def _group_words(group: Result) -> str:
    """Return what tells a group from the others, in words."""
    turn = {"cw": "clockwise", "ccw": "anticlockwise"}[str(group["direction"])]
    words = f"{turn}, {group['range']} range"
    if group.get("loading") == "couple":
        words += ", couple"
    if group.get("arm_length_m") is not None:
        words += f", arm {group['arm_length_m']:g} m"
    return words


def _environment(result: Result) -> Table:
    rows: list[tuple[str, ...]] = []
    for key, words in (
        ("temperature_c", "temperature (°C)"),
        ("humidity_percent", "relative humidity (%)"),
        ("pressure_hpa", "air pressure (hPa)"),
    ):
        ends = result["course"][key]
        if ends is None:
            rows.append((words, "not told", "not told", DASH))
        else:
            sizes = (ends["first"], ends["last"], ends["largest"] - ends["least"])
            rows.append((words, *(fixed(size, 2) for size in sizes)))
    head = ("", "at the first reading", "at the last", "largest less least")
    return Table("Environment", head, tuple(rows))


def _shunt(result: Result) -> Table:
    shunt = result.get("shunt")
    if shunt is None:
        return Table("Shunt check", (), ())
    words = {True: "within the tolerance", False: "outside the tolerance", None: "not compared"}
    change = words[shunt["within"]]
    if shunt["change"] is not None:
        limit = "" if shunt["tolerance"] is None else f" of {percent(shunt['tolerance'])} %"
        change = f"{percent(shunt['change'])} %, {change}{limit}"
    rows = (
        ("resistor (Ω)", fixed(shunt["resistor_ohm"], 0)),
        ("reading with less without (V)", fixed(shunt["reading_v"], 4)),
        ("at the last calibration (V)", declared(shunt["expected_v"])),
        ("change", change),
        ("torque equivalent (N·m)", fixed(shunt["torque_equivalent_nm"], 3)),
    )
    note = "The shunt checks amplifier, excitation and wiring, not the transducer."
    return Table("Shunt check", ("", ""), rows, note)


def _warnings(result: Result) -> Table:
    rows = [("departs from the guide's sequence", text) for text in result["deviations"]]
    rows += _significant(result)
    for odd in result["outliers"]:
        where = f"experiment {odd['experiment']}"
        if odd["kind"] == "reading":
            where += f", {odd['series']}, {odd['torque_nm']:.4g} N·m"
        size = f"{odd['statistic']:.2f} standard deviations off, limit {odd['limit']:.2f}"
        rows.append((f"{odd['kind']} stands off, kept", f"{where}: {size}"))
    for note in (*result.get("flags", ()), *result.get("notes", ())):
        rows.append((note["name"].replace("-", " "), note["detail"]))
    times = result["course"]["excluded_at_s"]
    if times:
        shown = ", ".join(f"{t:.2f}" for t in times[:20])
        rows.append(("samples left out of averages", f"{len(times)}, at {shown} s"))
    undeclared = result["torque"]["not_declared"]
    if undeclared:
        rows.append(("not declared, so without uncertainty", ", ".join(undeclared)))
    return Table("Warnings", ("what", "in words"), tuple(rows))


def _significant(result: Result) -> Iterator[tuple[str, str]]:
    """Yield differences and curvature that chance does not explain, with their size."""
    for key, words in (("direction", "directions differ"), ("ranges", "ranges differ")):
        pairs = result.get(key)
        if pairs is not None and _unlikely(pairs["probability"]):
            yield (
                words,
                f"{pairs['first']} less {pairs['second']}: {percent(pairs['relative']['value'])} % "
                f"of the gain, probability by chance {pairs['probability']:.2g}",
            )
    for group in result["groups"]:
        lack = group["lack_of_fit"]
        if lack is not None and _unlikely(lack["probability"]):
            yield (
                "not a straight line",
                f"{_group_words(group)}: {percent(lack['relative'])} % of the largest deflection, "
                f"probability by chance {lack['probability']:.2g}",
            )


def _unlikely(probability: float | None) -> bool:
    return probability is not None and probability < _CHANCE


def _readings(result: Result) -> Table:
    def reading(r: Result) -> str:
        volts = r["reading_v"]
        return short(volts, (r["reading_std_v"] or 0.0) / 10.0 or 1e-4 * abs(volts))

    def series(r: Result) -> str:
        return str(r["series"]) + ("" if r["kind"] == "reading" else f" ({r['kind']})")

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
    return make_table("Readings", columns, result["readings"])


def _signatures(result: Result) -> Table:
    days = result.get("validity_days")
    until = DASH if days is None else f"runs refuse it after {days:g} days unless told otherwise"
    rows = (
        (
            "calibrated by (name, date, signature)",
            (result.get("identity") or {}).get("operator") or "",
        ),
        ("checked by (name, date, signature)", ""),
        ("validity", until),
    )
    return Table("Signatures", ("", ""), rows, "End of the calibration record.")
