"""Tables of the calibration record: item, standards, evaluation step by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.calibrationwords import (
    STATEMENT,
    declared,
    fixed,
    group_words,
    percent,
    two_digits,
    volts,
)
from hdbench.report.elements import Table

__all__ = ["identity_tables", "step_tables"]

Result = Mapping[str, Any]
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


def identity_tables(result: Result) -> tuple[Table, ...]:
    """Return what was calibrated, with what."""
    item, standards = result.get("identity"), result.get("standards")
    if not item or not standards:
        return ()
    rows = tuple((words, declared(item.get(key))) for key, words in _ITEM.items())
    made = Table("What was calibrated", ("", ""), rows, STATEMENT)
    mass, length = standards["mass"], standards["length"]
    meter, torque = standards["instrument"], standards["torque"]
    account = result["torque"]
    grade = f"class {mass['accuracy_class']}" if mass["accuracy_class"] else ""
    limits = mass["relative_half_width"]
    size = grade if limits is None else f"{grade} ±{1e6 * limits:.3g} ppm".strip()
    half = length["half_width_m"]
    traced = (
        ("mass", size or "not declared", declared(mass["certificate"])),
        (
            "length",
            "not declared" if half is None else f"±{1e3 * half:.3g} mm",
            declared(length["certificate"]),
        ),
        ("gravity", f"{account['gravity_m_s2']:.6f} m/s²", str(account["gravity_source"])),
        ("instrument", _expanded(meter), declared(meter["certificate"])),
        ("instrument, type and serial", declared(meter["identity"]), ""),
        ("reference torque sensor", _expanded(torque), declared(torque["certificate"])),
    )
    return (made, Table("Standards", ("standard", "uncertainty", "certificate or source"), traced))


def _expanded(standard: Mapping[str, Any]) -> str:
    found = standard["relative_expanded_uncertainty"]
    return "not declared" if found is None else f"U = {1e6 * found:.3g} ppm (k = 2)"


def step_tables(result: Result) -> tuple[Table, ...]:
    """Return the evaluation step by step, one table for each group."""
    out = []
    for group in result.get("groups", ()):
        own = [s for s in result["steps"] if all(s[k] == group[k] for k in _GROUP)]
        rows = tuple(_step(step) for step in own)
        note = (
            f"{group['n_positions']} positions, {group['n_series']} series. Y: mean over the "
            "positions. b': repeatability, b: reproducibility (standard deviation), h: "
            "reversibility, fa: deviation from the line through zero. W: relative expanded "
            "uncertainty; I: loading with the cubic, II: loading and unloading with the line, its "
            "deviation added; k = 2 as in the guide, then k from the degrees of freedom. w, k and "
            "U belong to II where unloading was read, else to I. f0 = "
            f"{percent(group['zero_relative'])} %; {result['method']}."
        )
        title = f"Evaluation step by step: {group_words(group)}"
        out.append(Table(title, _STEP_HEAD, rows, note))
    return tuple(out)


_GROUP = ("direction", "range", "loading", "arm_length_m")
_STEP_HEAD = (
    "T (N·m)",
    "Y (mV)",
    "line (mV)",
    "b' (%)",
    "b (%)",
    "h (%)",
    "fa (%)",
    "w (%)",
    "k from dof",
    "W I, k = 2 (%)",
    "W I (%)",
    "W II, k = 2 (%)",
    "W II (%)",
    "U (N·m)",
)


def _step(step: Mapping[str, Any]) -> tuple[str, ...]:
    one, two = step["increasing"] or {}, step["increasing_decreasing"] or {}
    case = two or one
    line = step["deviation_up_down_relative"]
    return (
        f"{step['torque_nm']:.4f}",
        volts(step["deflection_v"]),
        volts(step["fitted_v"]),
        percent(step["repeatability_relative"]),
        percent(step["reproducibility_relative"]),
        percent(step["reversibility_relative"]),
        percent(step["deviation_linear_relative"] if line is None else line),
        percent(case.get("relative_std")),
        fixed(case.get("coverage_factor"), 2),
        percent(one.get("expanded_relative_k2")),
        percent(one.get("expanded_relative")),
        percent(two.get("expanded_relative_k2_with_deviation")),
        percent(two.get("expanded_relative_with_deviation")),
        two_digits(case.get("expanded_nm")),
    )
