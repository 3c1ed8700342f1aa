"""Tables of the calibration record: the gain, its spread, its budget, what was decided."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.calibrationbudget import budget_table, corrections_table
from hdbench.report.calibrationwords import (
    fixed,
    percent,
    rounded_with,
    statement,
)
from hdbench.report.elements import Table
from hdbench.report.numbers import DASH, MINUS, short

__all__ = ["result_tables"]

Result = Mapping[str, Any]


def result_tables(result: Result) -> tuple[Table, ...]:
    """Return what the calibration found about the gain."""
    if "uncertainty" not in result:
        return ()
    made = (
        _gain(result),
        _spread(result),
        _equations(result),
        _classes(result),
        _acceptance(result),
        budget_table(result),
        corrections_table(result),
    )
    return tuple(table for table in made if table.rows)


def _gain(result: Result) -> Table:
    rows = []
    one = result.get("gain_basis") in ("residual", "repetitions")
    names = (
        ("mean_of_positions", "this one position" if one else "mean of positions"),
        ("any_one_position", "any one position"),
        ("naive", "as if all experiments were independent (for comparison only)"),
    )
    for key, words in names:
        body = result["uncertainty"].get(key)
        if body is None:
            continue
        value, expanded = rounded_with(body["value"], body["expanded"])
        rows.append(
            (
                words,
                value,
                expanded,
                percent(body["expanded_relative"], 2),
                fixed(body["coverage_factor"], 2),
                DASH if body["dof"] is None else f"{body['dof']:.3g}",
            )
        )
    trial = result.get("monte_carlo")
    note = statement(result["uncertainty"]["mean_of_positions"])
    if isinstance(trial, Mapping):
        low, high = trial["interval_nm_per_v"]
        word = "agree" if trial["agrees_with_formula"] else "do not agree"
        note += (
            f" Monte Carlo with {trial['draws']} trials (seed {trial['seed']}): 95 % from "
            f"{short(low, trial['expanded_nm_per_v'] / 2)} to "
            f"{short(high, trial['expanded_nm_per_v'] / 2)} N·m/V; its ends {word} with the "
            f"formula within {short(trial['tolerance_nm_per_v'])} N·m/V."
        )
    head = ("gain", "value (N·m/V)", "U (N·m/V)", "U (%)", "k", "degrees of freedom")
    return Table("Gain and its uncertainty", head, tuple(rows), note)


def _spread(result: Result) -> Table:
    rows: list[tuple[str, str, str]] = []
    interval = result.get("consistency_interval")
    if result.get("consistency") is not None and interval:
        rows.append(
            (
                f"consistency of {result['n_experiments']} gains, s/mean",
                f"{percent(result['consistency'])} %",
                f"95 %: {percent(interval[0], 2)} to {percent(interval[1], 2)} %",
            )
        )
    rows += [*_places(result), *_pairs(result)]
    between = result.get("consensus")
    if between is not None:
        rows.append(
            (
                "scatter over what the lines' own uncertainties explain (Birge ratio)",
                f"{between['birge_ratio']:.3g}",
                "above 1.4 the lines' own uncertainties do not explain the scatter",
            )
        )
    effects = result["direction_effects"]
    note = ""
    if effects["group"]:
        both = " and ".join(effects["group"])
        note = f"{both} are one group here: {effects['reason']}."
    return Table("Consistency and spread", ("what", "size", "more"), tuple(rows), note)


def _places(result: Result) -> list[tuple[str, str, str]]:
    rows: list[tuple[str, str, str]] = []
    places = result.get("positions")
    if places is not None:
        mean = abs(float(result["gain_nm_per_v"]["value"]))
        for key, words in (
            ("repeatability_nm_per_v", "repeatability (within a position)"),
            ("between_positions_nm_per_v", "spread between positions"),
            ("reproducibility_nm_per_v", "reproducibility (any one experiment)"),
        ):
            rows.append((words, f"{percent(places[key] / mean)} %", f"{places[key]:.4g} N·m/V"))
    return rows


def _pairs(result: Result) -> list[tuple[str, str, str]]:
    rows: list[tuple[str, str, str]] = []
    for key, words in (("direction", "direction"), ("ranges", "range")):
        body = result.get(key)
        if body is not None:
            found, chance = body["relative"], body["probability"]
            shown = DASH if chance is None else f"{chance:.2g}"
            rows.append(
                (
                    f"{words}: {body['first']} less {body['second']}",
                    f"{percent(found['value'])} ± {percent(found['std'])} %",
                    f"{body['n_pairs']} pairs; probability without a difference: {shown}",
                )
            )
    return rows


def _equations(result: Result) -> Table:
    rows = []
    for group in result["groups"]:
        gain = group["gain_up_down_nm_per_v"] or group["gain_up_nm_per_v"]
        if gain is None:
            continue
        cubic = group["cubic_v"]
        # deflections are kept positive with the load; a bridge wired the other way has the sign
        turn = -1.0 if float(result["gain_nm_per_v"]["value"]) < 0.0 else 1.0
        power = DASH
        if cubic is not None:
            a, b, c = (turn * float(x) for x in cubic)
            power = f"V = {a:.6g} T {b:+.3g} T² {c:+.3g} T³".replace("-", MINUS)
        rows.append(
            (
                f"{group['direction']}, {group['range']}",
                f"V = {turn / gain:.6g} T".replace("-", MINUS),
                f"T = {turn * gain:.6g} V".replace("-", MINUS),
                power,
                f"0 to {group['largest_torque_nm']:.4g}",
            )
        )
    note = (
        "V: reading less the zero before loading, V. T: torque, N·m; for anticlockwise groups both "
        "with their signs turned. Lines through zero, loading "
        "and unloading together where both were measured; the cubic holds for loading and only in "
        "its range."
    )
    head = ("group", "volts of torque", "torque of volts", "cubic", "range (N·m)")
    return Table("Equation both ways", head, tuple(rows), note)


def _classes(result: Result) -> Table:
    rows = []
    for group in result["groups"]:
        name = f"{group['direction']}, {group['range']}"
        for one, words in _criteria(group):
            rows.append(
                (
                    name,
                    words,
                    _criterion(one["name"], one["value"]),
                    _criterion(one["name"], one["limit"]),
                    "none" if one["class"] is None else f"{one['class']:g}",
                )
            )
    note = f"{result['class_reason']}."
    if result.get("class") is not None:
        note = f"Overall: class {result['class']:g}, indicative. {note}"
    head = ("group", "criterion", "largest", "limit of the class", "class")
    return Table("Indicative class, in the manner of EURAMET cg-14", head, tuple(rows), note)


def _criteria(group: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], str]]:
    """Return every criterion once; loading alone differs by its fit from loading and unloading."""
    one, two = (
        group[key]["criteria"] for key in ("class_increasing", "class_increasing_decreasing")
    )
    both = {str(c["name"]): c for c in two}
    out = [(c, str(c["name"])) for c in two if c["name"] != "fit"]
    out += [(c, str(c["name"])) for c in one if c["name"] not in both and c["name"] != "fit"]
    out += [(c, "fit, loading, cubic") for c in one if c["name"] == "fit"]
    out += [(c, "fit, loading and unloading, line") for c in two if c["name"] == "fit"]
    return out


def _criterion(name: str, value: float) -> str:
    return f"{value:.0f} steps" if name == "resolution" else f"{percent(value)} %"


def _acceptance(result: Result) -> Table:
    body = result["acceptance"]
    words = {True: "yes", False: "no", None: "not testable"}
    rows = tuple(
        (
            test["name"],
            DASH if test["value"] is None else short(test["value"]),
            DASH if test["upper"] is None else short(test["upper"]),
            short(test["limit"]),
            words[test["passed"]],
        )
        for test in body["tests"]
    )
    head = ("what", "value", "upper end of its 95 % interval", "limit", "held")
    return Table("Acceptance", head, rows, f"Decision rule: {body['statement']}.")
