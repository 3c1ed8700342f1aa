"""The whole result: intervals that cover, limits that decide, budget and Monte Carlo."""

import json
import math
import runpy
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from worked_example import masses

from hdbench.calibration import evaluate_calibration
from hdbench.calibration.budget import combined, expanded_uncertainty, propagate
from hdbench.calibration.evaluation import decide
from hdbench.calibration.lever import with_shares
from hdbench.errors import DataError
from hdbench.profile import load_profile, parse_profile
from hdbench.records import LoadReading, Loads
from hdbench.records.loads import read_loads, write_loads
from hdbench.results.calibration import BudgetRow, LimitTest

count_intervals = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "coverage.py"))["count"]


def row(name, relative, distribution, dof=None):
    size = {"half_width": relative, "relative_std": relative, "dof": dof}
    return BudgetRow(name=name, group="", distribution=distribution, declared=True, **size)


# the published example: position of 3 dof beside torque, crosstalk and temperature
EXAMPLE = [
    row("position", 0.070563 / 6.6, "t", 3.0),
    row("torque", 0.013e-2, "normal"),
    row("crosstalk", 0.19e-2 / math.sqrt(3.0), "rectangular"),
    row("temperature", 0.05e-2 / math.sqrt(3.0), "rectangular"),
]


def bench_with(text):
    return parse_profile(load_profile("cim-tr-97-06").text + text, "p").data


def test_the_monte_carlo_interval_is_that_of_the_formula():
    parts = [(6.6 * r.relative_std, r.dof) for r in EXAMPLE]
    std, dof = combined(parts)
    formula = expanded_uncertainty(std, dof)
    found = propagate(6.6, EXAMPLE, (std, formula.expanded), seed=1)
    # ends of a t of 3 dof from a million draws scatter by 6e-4; five of them, and the 0.4 % by
    # which the effective degrees of freedom are an approximation
    low, high = found.interval_nm_per_v
    assert (low, high) == pytest.approx((6.3768, 6.8232), abs=3e-3)
    assert found.expanded_nm_per_v == pytest.approx(formula.expanded, rel=0.02)
    # a t of 3 dof has sqrt(3) times its scale: intervals are compared, not standard deviations
    assert found.std_nm_per_v > 1.5 * std
    shortest = found.shortest_interval_nm_per_v
    assert shortest[1] - shortest[0] <= high - low
    again = propagate(6.6, EXAMPLE, (std, formula.expanded), seed=1)
    assert again == found


def test_the_combined_uncertainty_is_that_of_gtc():
    from GTC import dof, uncertainty, ureal

    gain = 6.6 * (
        1.0
        + ureal(0.0, EXAMPLE[0].relative_std, 3)
        + sum(ureal(0.0, r.relative_std) for r in EXAMPLE[1:])
    )
    std, free = combined([(6.6 * r.relative_std, r.dof) for r in EXAMPLE])
    assert std == pytest.approx(uncertainty(gain), rel=1e-12)
    assert free == pytest.approx(dof(gain), rel=1e-9)


def test_shares_of_a_budget_add_up_to_one():
    shares = [entry.share for entry in with_shares(EXAMPLE)]
    assert math.fsum(shares) == pytest.approx(1.0, rel=1e-12)
    assert with_shares([row("nothing", 0.0, "normal")])[0].share == 0.0


def test_intervals_of_simulated_calibrations_cover_the_mean_of_both_directions():
    n = 150
    found = count_intervals(n, 11, "balanced")
    # binomial(150, 0.95), false alarm 1e-3; the naive one is meant to be far too short
    assert stats.binom.ppf(5e-4, n, 0.95) <= found.covered <= stats.binom.ppf(0.9995, n, 0.95)
    assert found.naive < stats.binom.ppf(1e-4, n, 0.95)
    assert found.half_width > 1.5 * found.naive_half_width


def test_a_gain_holds_what_is_declared_of_the_torque_and_does_not_average_it_away():
    bare = bench_with("")
    sure = bench_with("\n[standards.length]\nhalf_width_m = 0.01\n")
    few, many = (evaluate_calibration(masses(n), max_consistency=0.1, bench=sure) for n in (4, 16))
    common = 0.01 / math.sqrt(3.0) / 0.5
    for result in (few, many):
        # 1.2 % of the length stay, whatever the number of positions
        assert result.gain_nm_per_v.std / result.gain_nm_per_v.value >= common
    without = evaluate_calibration(masses(), max_consistency=0.1, bench=bare)
    assert without.gain_nm_per_v.std < few.gain_nm_per_v.std
    rows = {r["name"]: r for r in few.to_json()["budget"]}
    assert rows["arm length"]["relative_std"] == pytest.approx(common, rel=1e-6)
    assert rows["mass of the weights"]["declared"] is False
    assert rows["mass of the weights"]["origin"] == "not declared"


def test_a_bench_that_declares_nothing_gives_the_scatter_alone():
    loads = masses()
    bare = evaluate_calibration(loads, max_consistency=0.1, bench=bench_with(""))
    alone = evaluate_calibration(loads, max_consistency=0.1)
    assert bare.gain_nm_per_v == alone.gain_nm_per_v
    assert bare.to_json()["torque"]["not_declared"]


def test_buoyancy_lowers_the_gain_of_masses_and_not_of_given_torques():
    air = "air_density_kg_m3 = 1.2\n\n[calibration]"
    text = load_profile("cim-tr-97-06").text.replace("[calibration]", air)
    bench = parse_profile(text, "p").data
    heavy = evaluate_calibration(masses(), max_consistency=0.1)
    light = evaluate_calibration(masses(), max_consistency=0.1, bench=bench)
    ratio = light.gain_nm_per_v.value / heavy.gain_nm_per_v.value
    # a conventional mass in air of 1.2 kg/m^3 presses like 1 - 1.2/8000 of itself
    assert ratio == pytest.approx(1.0 - 1.2 / 8000.0, abs=1e-9)
    given = Loads(tuple(replace(r, mass_kg=None) for r in masses().readings))
    same = evaluate_calibration(given, max_consistency=0.1, bench=bench)
    assert same.gain_nm_per_v.value == heavy.gain_nm_per_v.value


@pytest.mark.parametrize(
    ("limits", "accepted"),
    [
        *(("", True), ("max_class = 0.05", False), ("max_class = 5.0", True)),
        ("max_expanded_uncertainty = 0.05", True),
        ("max_expanded_uncertainty = 0.001", False),
        ("max_hysteresis = 1e-9", False),
        *((f"max_{name} = 0.01", True) for name in ("zero_return", "lack_of_fit")),
        ("max_direction_asymmetry = 0.01", True),
    ],
)
def test_limits_of_the_profile_decide(limits, accepted):
    bench = bench_with(f"\n[calibration.limits]\n{limits}\n")
    result = evaluate_calibration(masses(), max_consistency=0.1, bench=bench)
    assert result.accepted is accepted
    assert result.to_json()["acceptance"]["decision_rule"] == "simple"


def test_the_decision_rule_is_stated_and_guarded_acceptance_is_stricter():
    guarded = bench_with('\n[calibration.limits]\ndecision_rule = "guarded"\n')
    simple = evaluate_calibration(masses(), max_consistency=0.015)
    strict = evaluate_calibration(masses(), max_consistency=0.015, bench=guarded)
    assert simple.consistency is not None
    assert simple.consistency < 0.015 < strict.consistency_interval[1]
    assert (simple.accepted, strict.accepted) == (True, False)
    assert "upper end" in strict.to_json()["acceptance"]["statement"]


def test_a_value_that_cannot_be_tested_accepts_nothing_and_nan_is_refused():
    held, unknown, broken = (LimitTest(name="a", value=v, limit=2.0) for v in (1.0, None, 3.0))
    assert decide([held, unknown], "simple")[0] is None
    assert decide([broken, unknown], "simple")[0] is False
    with pytest.raises(ValueError, match="finite"):
        LimitTest(name="c", value=math.nan, limit=2.0)


def test_a_reading_off_the_common_course_is_flagged_and_kept():
    rows = list(masses().readings)
    for place in (13, 51):
        rows[place] = replace(rows[place], reading_v=rows[place].reading_v + 0.02)
    result = evaluate_calibration(Loads(tuple(rows)), max_consistency=0.1)
    found = [o for o in result.to_json()["outliers"] if o["kind"] == "reading"]
    named = {(o["experiment"], o["series"], round(o["torque_nm"], 3)) for o in found}
    wanted = {(r.experiment, r.series, round(abs(r.torque_nm), 3)) for r in (rows[13], rows[51])}
    assert wanted <= named
    assert result.n_samples == len(rows)


def test_the_low_range_is_compared_with_the_full_one_at_each_position():
    full, low = masses().readings, []
    for r in full:
        quarter = {"torque_nm": r.torque_nm / 4.0, "reading_v": r.reading_v / 4.0 * (1.0 + 1e-3)}
        low.append(
            replace(r, experiment=f"{r.experiment}-low", range="low", mass_kg=None, **quarter)
        )
    body = evaluate_calibration(Loads((*full, *low)), max_consistency=0.1).to_json()
    assert body["ranges"]["n_pairs"] == 8
    # sensitivities 0.1 % apart make gains 0.1 % apart the other way
    assert body["ranges"]["relative"]["value"] == pytest.approx(-1e-3, rel=0.01)
    assert {g["range"] for g in body["groups"]} == {"full", "low"}


def test_side_force_and_asymmetry_stay_one_group_in_the_result():
    body = evaluate_calibration(masses(), max_consistency=0.1, bench=bench_with("")).to_json()
    assert body["direction_effects"]["group"] == ["side-force", "direction-asymmetry"]
    assert body["direction_effects"]["separated"] is False
    single = masses().readings
    couple = [replace(r, experiment=f"{r.experiment}-c") for r in single]
    words = ("single",) * len(single) + ("couple",) * len(couple)
    both = Loads((*single, *couple), extra_columns={"loading": words})
    body = evaluate_calibration(both, max_consistency=0.1, bench=bench_with("")).to_json()
    assert body["direction_effects"]["separated"] is True
    # the same readings with and without side force: there is none
    assert abs(body["direction_effects"]["crosstalk_v_per_n"]["value"]) < 1e-4


def test_the_side_force_is_sized_and_cancels_in_the_mean_of_both_directions():
    bench = bench_with("")
    body = evaluate_calibration(masses(), max_consistency=0.1, bench=bench).to_json()
    assert body["side_force"]["force_n"] == pytest.approx(8.0 * bench.arm.gravity_m_s2)
    assert body["side_force"]["cancels"] is True
    one = Loads(tuple(r for r in masses().readings if r.direction == "cw"))
    alone = evaluate_calibration(one, max_consistency=0.1, bench=bench).to_json()
    assert alone["side_force"]["cancels"] is False
    assert alone["side_force"]["half_direction_difference"] is None
    assert "side force, one direction only" in [r["name"] for r in alone["budget"]]


def test_shunt_readings_are_compared_with_those_of_the_last_calibration():
    shunt = "\n[calibration.shunt]\nresistor_ohm = 144200.0\nexpected_v = 6.0\n"
    rows = (replace(masses().readings[0], reading_v=6.003), *masses().readings)
    words = ("shunt",) + ("",) * (len(rows) - 1)
    loads = Loads(rows, extra_columns={"kind": words})
    body = evaluate_calibration(loads, max_consistency=0.1, bench=bench_with(shunt)).to_json()
    assert body["shunt"]["change"] == pytest.approx(0.0005, rel=1e-9)
    assert body["shunt"]["within"] is True
    assert body["shunt"]["torque_equivalent_nm"] == pytest.approx(6.6 * 6.0, rel=0.02)


def test_the_course_beside_the_readings_is_read(tmp_path):
    write_loads(tmp_path / "loads.csv", masses())
    (tmp_path / "sequence.csv").write_text(
        "time_s,kind,experiment,torque_nm,reading_v,superseded\n"
        "-90,preload,,39.2,6.0,\n-30,shunt,,,6.0,\n0,zero,0cw,0,0.01,\n",
        encoding="utf-8",
    )
    bench = bench_with("")
    loads = read_loads(tmp_path / "loads.csv", bench.arm)
    body = evaluate_calibration(loads, max_consistency=0.1, bench=bench).to_json()
    assert body["course"]["n_preloads"] == 1
    assert body["shunt"]["reading_v"] == 6.0
    assert [entry["kind"] for entry in body["sequence"]] == ["preload", "shunt", "zero"]
    (tmp_path / "sequence.csv").write_text("time_s,kind\nsoon,zero\n", encoding="utf-8")
    with pytest.raises(DataError, match="time_s"):
        read_loads(tmp_path / "loads.csv", bench.arm)


@pytest.mark.parametrize(
    ("column", "cell"),
    [
        *(("kind", "prelod"), ("repeat", "-1"), ("repeat", "1.5"), ("arm_length_m", "0")),
        *(("pressure_hpa", "nan-ish"), ("loading", "double"), ("excluded_at_s", "1;x")),
    ],
)
def test_an_optional_column_with_nonsense_is_refused_with_its_place(column, cell):
    rows = masses().readings
    cells = ("",) * 3 + (cell,) + ("",) * (len(rows) - 4)
    loads = Loads(rows, source="loads.csv", extra_columns={column: cells})
    with pytest.raises(DataError, match=rf"reading 4.*: .*{column}"):
        evaluate_calibration(loads, max_consistency=0.1)


def test_the_record_has_every_reading_and_says_what_its_class_is():
    result = evaluate_calibration(
        masses(temperature_c=21.0), max_consistency=0.1, bench=bench_with(""), monte_carlo_seed=0
    )
    assert len(result.readings) == 80
    assert result.monte_carlo.draws == 1_000_000
    assert "indicative" in result.class_reason
    assert result.course.temperature_c.first == 21.0


READINGS = st.lists(
    st.tuples(
        st.sampled_from(["a", "b", "c"]),
        st.sampled_from(["up", "down"]),
        st.sampled_from([0.0, 1e-9, 4.9, 9.8, 9.8001, 19.6, 39.2]),
        st.sampled_from([0.0, 1e-3, -5e-3, 0.3]),
    ),
    min_size=1,
    max_size=24,
)


@settings(max_examples=60, deadline=None)
@given(rows=READINGS, gain=st.sampled_from([6.6, -6.6, 1e5, 1e-6]), same=st.booleans())
def test_any_loads_give_a_result_or_a_reason(rows, gain, same):
    places = {"a": (0.0, "cw"), "b": (0.0 if same else 2.0, "ccw"), "c": (4.0, "cw")}
    readings = []
    for name, series, size, off in rows:
        place, way = places[name]
        torque = size if way == "cw" else -size
        volts = torque / gain + off
        readings.append(LoadReading(name, place, "full", way, series, torque, volts))
    try:
        result = evaluate_calibration(Loads(tuple(readings)), max_consistency=0.05)
    except DataError as error:
        fix = error.fix
    else:
        # no number is NaN or infinite, whatever is missing
        fix = json.dumps(result.to_json(), allow_nan=False)
    assert fix
