"""Two results held against each other: closed forms, simulated coverage, damaged input."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runkit import misalignment_result, write_run
from runkit import quantity as q
from scipy import stats

from hdbench.comparison import compare_runs, comparison_csv
from hdbench.comparison.orders import OrderPair, compare_pattern
from hdbench.comparison.score import SharedPart, compared, own_part
from hdbench.errors import DataError
from hdbench.estimation.harmonics import combine
from hdbench.records import Quantity
from hdbench.records.jsonfile import dumps

HEAD = {"hdbench_version": "0", "profile": None}
NAMED = ("x", "x", "N m")


def store(path: Path, kind: str, **body: Any) -> Path:
    """Write a result file."""
    path.write_text(dumps({"schema": f"hdbench/{kind}/1", **HEAD, **body}))
    return path


def both(folder: Path, kind: str, first: dict[str, Any], second: dict[str, Any]) -> list[Path]:
    """Write two result files."""
    files = folder / "a.json", folder / "b.json"
    return [store(file, kind, **body) for file, body in zip(files, (first, second), strict=True)]


def calibration(gains: dict[float, float], std: float, **more: Any) -> dict[str, Any]:
    """Return a calibration result with one experiment per position."""
    values = list(gains.values())
    return {
        "gain_nm_per_v": q(float(np.mean(values)), std, len(values) - 1.0),
        "consistency": float(np.std(values, ddof=1) / np.mean(values)),
        "n_experiments": len(values),
        "accepted": True,
        "experiments": [
            {"id": f"p{i}", "position_rad": at, "direction": "cw", "range": "full",
             "gain_nm_per_v": gain, "zero_v": 0.0, "intercept_nm": 0.0, "residual_rms_nm": 0.0,
             "n": 10}
            for i, (at, gain) in enumerate(gains.items())
        ],
        **more,
    }  # fmt: skip


def scale(std: float = 0.08, source: str = "calibration R") -> dict[str, Any]:
    return {"gain_nm_per_v": q(6.6, std, 3.0), "source": source, "sha256": "ab"}


# -- the score ----------------------------------------------------------------------------------


def test_independent_quantities_have_the_root_sum_of_squares():
    found = compared(NAMED, Quantity(1.0, 0.03), Quantity(1.1, 0.04), confidence=0.95)
    assert found.difference.std == pytest.approx(0.05)
    assert found.score == pytest.approx(0.1 / (1.959964 * 0.05), rel=1e-6)
    assert found.moved is True
    assert found.correlation == 0.0


def test_a_common_part_takes_twice_the_covariance_off():
    a, b = Quantity(10.0, 0.5), Quantity(12.0, 0.6)
    found = compared(NAMED, a, b, common=(SharedPart(0.4, 0.48),), confidence=0.95)
    r = 0.4 * 0.48 / (0.5 * 0.6)
    assert found.correlation == pytest.approx(r)
    expected = math.sqrt(0.5**2 + 0.6**2 - 2.0 * r * 0.5 * 0.6)
    assert found.difference.std == pytest.approx(expected)


def test_what_is_left_of_an_uncertainty_has_the_dof_it_was_made_of():
    noise, gain = (3.9e-4, 41.0), (4.9e-3, 3.0)
    std, dof = combine(noise, gain)
    left = own_part(Quantity(0.39, std, dof), [gain])
    assert left[0] == pytest.approx(noise[0], rel=1e-6)
    assert left[1] == pytest.approx(noise[1], rel=1e-3)


def test_the_same_number_twice_has_not_moved_and_another_without_uncertainty_has():
    same = compared(NAMED, Quantity(1.0, 0.0), Quantity(1.0, 0.0), confidence=0.95)
    assert (same.score, same.moved) == (0.0, False)
    other = compared(NAMED, Quantity(1.0, 0.0), Quantity(1.1, 0.0), confidence=0.95)
    assert (other.score, other.moved) == (None, None)


# -- calibrations -------------------------------------------------------------------------------


def drawn(rng: np.random.Generator, place: Path, name: str, common: float, **more: Any) -> Path:
    """Write a calibration at four positions with 1 % new scatter each and a common error."""
    gains = {at: 6.6 * (1.0 + common + 0.01 * rng.standard_normal()) for at in (0.0, 1.5, 3.0, 4.5)}
    scatter = float(np.std(list(gains.values()), ddof=1)) / 2.0
    return store(
        place / name, "calibration", **calibration(gains, math.hypot(scatter, 6.6 * 0.005), **more)
    )


def row(certificate: str) -> dict[str, Any]:
    return {"name": "mass", "group": "applied torque", "declared": True, "origin": certificate,
            "half_width": 0.00866, "distribution": "rectangular", "relative_std": 0.005,
            "dof": None}  # fmt: skip


def false_alarms(place: Path, certificates: tuple[str, str], n: int) -> float:
    """Return how often two calibrations of one sensor are said to have moved."""
    rng = np.random.default_rng(11)
    moved = 0
    for _ in range(n):
        error = 0.005 * rng.standard_normal(2)
        if certificates[0] == certificates[1]:
            error[1] = error[0]
        files = [
            drawn(rng, place, f"{i}.json", error[i], budget=[row(certificates[i])])
            for i in range(2)
        ]
        moved += compare_runs(*files).verdict == "moved"
    return moved / n


@pytest.mark.parametrize(
    ("certificates", "lowest"),
    # with one certificate all that is left is a t test: 5 %. A known part beside scatter of few
    # degrees of freedom is covered by 95 to 97 %
    [(("K1", "K1"), 0.05), pytest.param(("K1", "K2"), 0.03, marks=pytest.mark.campaign)],
)
def test_two_calibrations_of_one_sensor_are_told_apart_in_5_of_100(certificates, lowest, tmp_path):
    n = 400
    slack = 3.0 * math.sqrt(0.05 * 0.95 / n)
    assert lowest - slack < false_alarms(tmp_path, certificates, n) < 0.05 + slack


def test_the_same_certificate_correlates_and_another_does_not(tmp_path):
    rng = np.random.default_rng(2)
    a = drawn(rng, tmp_path, "a.json", 0.0, budget=[row("K1")])
    b = drawn(rng, tmp_path, "b.json", 0.0, budget=[row("K1")])
    c = drawn(rng, tmp_path, "c.json", 0.0, budget=[row("K2")])
    same, other = compare_runs(a, b), compare_runs(a, c)
    assert same.outcome.quantities[0].correlation > 0.1
    assert "mass" in same.outcome.assumption
    assert other.outcome.quantities[0].correlation == 0.0
    assert compare_runs(a, b, independent=True).outcome.quantities[0].correlation == 0.0


def test_what_a_position_does_every_time_cancels(tmp_path):
    # 3 % between positions, the same in both; a true change of 0.5 %
    spread = {0.0: 6.4, 1.5: 6.7, 3.0: 6.5, 4.5: 6.8}
    after = {
        at: 1.005 * g + e for (at, g), e in zip(spread.items(), (2e-3, -2e-3) * 2, strict=True)
    }
    sides = calibration(spread, 0.09), calibration(after, 0.09)
    found = compare_runs(*both(tmp_path, "calibration", *sides))
    plain, paired = found.outcome.quantities[:2]
    assert plain.moved is False
    assert paired.moved is True
    assert found.verdict == "moved"
    # a paired t test by another library
    t = stats.ttest_rel(list(after.values()), list(spread.values()))
    assert paired.score is not None
    k = float(stats.t.ppf(0.975, 3))
    assert paired.score == pytest.approx(abs(float(t.statistic)) / k, rel=1e-9)


def test_half_a_turn_written_with_four_digits_is_the_same_position(tmp_path):
    places = (0.0, math.pi / 2.0, math.pi, 1.5 * math.pi)
    sides = [
        calibration({at: 6.6 + 0.01 * k + bend * k**2 for k, at in enumerate(angles)}, 0.01)
        for angles, bend in ((places, 0.0), ([round(at, 4) for at in places], 1e-4))
    ]
    found = compare_runs(*both(tmp_path, "calibration", *sides))
    assert "4 positions" in found.outcome.quantities[1].label


def test_positions_that_differ_leave_the_means_to_decide(tmp_path):
    first = calibration({0.0: 6.6, 2.0: 6.6, 4.0: 6.61}, 0.01)
    second = calibration({1.0: 6.9, 3.0: 6.9, 5.0: 6.91}, 0.01)
    found = compare_runs(*both(tmp_path, "calibration", first, second))
    assert [x.name for x in found.outcome.quantities if x.decides] == ["gain_nm_per_v"]
    assert found.verdict == "moved"


# -- misalignment -------------------------------------------------------------------------------


def misalignment(amplitude: float, phase: float = 0.3, **more: Any) -> dict[str, Any]:
    std = math.hypot(0.004, amplitude * 0.08 / 6.6)
    return misalignment_result(amplitude, std, phase, **{"torque_scale": scale(), **more})


def test_a_reassembly_that_takes_10_nm_to_below_2_has_moved(tmp_path):
    # the report, section 5: 10 N m peak to peak before, less than 2 N m after
    sides = misalignment(5.0), misalignment(0.9, phase=-1.0)
    found = compare_runs(*both(tmp_path, "misalignment", *sides))
    assert found.verdict == "moved"
    first = found.outcome.quantities[0]
    assert first.difference.value == pytest.approx(-8.2)
    # one gain: its error goes with the difference only, beside the noise of both
    expected = math.hypot(0.008, 0.008, 8.2 * 0.08 / 6.6)
    assert first.difference.std == pytest.approx(expected, rel=1e-9)
    assert "10 to 1.8 N m" in found.sentence


def test_another_gain_in_each_is_independent(tmp_path):
    other = misalignment(5.0, torque_scale=scale(source="calibration S"))
    found = compare_runs(*both(tmp_path, "misalignment", misalignment(5.0), other))
    assert found.outcome.quantities[0].correlation == 0.0
    assert "two gains" in found.outcome.assumption
    assert found.verdict == "within-uncertainty"


def test_a_turned_misalignment_counts_only_with_one_origin(tmp_path):
    a, b = both(tmp_path, "misalignment", misalignment(1.0), misalignment(1.0, phase=1.3))
    assert compare_runs(a, b).verdict == "within-uncertainty"
    told = compare_runs(a, b, same_origin=True)
    assert told.moved == ("order vectors",)
    length = told.outcome.pattern.to_dict()["orders"][0]["difference"]["amplitude_nm"]["value"]
    assert length == pytest.approx(2.0 * math.sin(0.5))


# -- ripple -------------------------------------------------------------------------------------


def pair(order: float, a: complex, b: complex, std: float) -> OrderPair:
    def polar(z: complex) -> tuple[Quantity, Quantity]:
        return Quantity(abs(z), std), Quantity(math.atan2(z.imag, z.real), std / abs(z))

    (ra, pa), (rb, pb) = polar(a), polar(b)
    return OrderPair(order, ra, rb, pa, pb)


def turned(z: complex, angle: float) -> complex:
    return z * complex(math.cos(angle), math.sin(angle))


TRUTH = {2.0: 0.4 + 0.1j, 4.0: 0.15 - 0.1j}


@pytest.mark.parametrize("shift", [0.0, 0.7, 2.0, -2.9])
def test_a_pattern_turned_by_any_shift_is_the_same_pattern(shift):
    pairs = [pair(order, z, turned(z, order * shift), 0.001) for order, z in TRUTH.items()]
    found = compare_pattern(pairs, same_origin=False, confidence=0.95)
    assert found.score == pytest.approx(0.0, abs=1e-3)
    # orders 2 and 4 know the shift up to half a turn
    assert math.remainder(found.shift_rad - shift, math.pi) == pytest.approx(0.0, abs=1e-5)


def test_a_phase_between_the_orders_that_changed_is_found():
    two, four = TRUTH.values()
    moved = [pair(2.0, two, two, 0.001), pair(4.0, four, turned(four, 0.3), 0.001)]
    found = compare_pattern(moved, same_origin=False, confidence=0.95)
    assert found.score is not None
    assert found.score > 5.0


@pytest.mark.parametrize(
    ("same_origin", "free"), [pytest.param(True, 4, marks=pytest.mark.campaign), (False, 3)]
)
def test_two_patterns_of_one_truth_are_told_apart_in_5_of_100(same_origin, free):
    rng = np.random.default_rng(8)
    std, n = 0.005, 300
    scores = np.empty(n)
    for trial in range(n):
        shift = 0.0 if same_origin else rng.uniform(-math.pi, math.pi)
        noise = std * rng.standard_normal((2, 2, 2))
        pairs = []
        for (order, z), (a, b) in zip(TRUTH.items(), noise, strict=True):
            second = turned(z + complex(*b), order * shift)
            pairs.append(pair(order, z + complex(*a), second, std))
        found = compare_pattern(pairs, same_origin=same_origin, confidence=0.95)
        assert found.score is not None
        scores[trial] = found.score
    # three standard deviations of a share and of a mean of chi-squared with `free` degrees
    assert abs((scores > 1.0).mean() - 0.05) < 3.0 * math.sqrt(0.05 * 0.95 / n)
    squares = scores**2 * float(stats.chi2.ppf(0.95, free))
    assert abs(squares.mean() - free) < 3.0 * math.sqrt(2.0 * free / n)


def ripple(*orders: tuple[float, float, float]) -> dict[str, Any]:
    return {
        "ripple": [
            {"order": k, "amplitude_nm": q(a, 0.001), "phase_rad": q(p, 0.001 / a)}
            for k, a, p in orders
        ],
        "motor_velocity_rad_s": {"mean": 150.0, "std": 1.0, "min": 140.0, "max": 160.0},
        "torque_rms_nm": {"measured": 0.7, "filtered": 0.1},
        "filter": {"orders": [2.0, 4.0]},
        "torque_scale": {**scale(), "gain_nm_per_v": q(6.6, 0.0)},
    }


def test_an_amplitude_that_grew_and_an_order_that_is_gone_are_named(tmp_path):
    sides = ripple((2.0, 0.4, 0.1), (4.0, 0.2, 1.0)), ripple((2.0, 0.5, 0.1))
    found = compare_runs(*both(tmp_path, "ripple", *sides))
    assert found.moved == ("ripple[order=2].amplitude_nm", "only in A: order 4")
    body = found.to_dict()
    dumps(body)
    assert body["overlay"]["a"]["y"][0] == pytest.approx(0.4 * math.cos(0.1))


# -- diagnosis, files, errors -------------------------------------------------------------------


def test_a_new_cause_and_a_grown_one_are_named(tmp_path, named_cause):
    def cause(name: str, value: float) -> dict[str, Any]:
        place = {"value": 6.0, "std": None, "unit": "s"}
        size = {"value": value, "std": 0.01, "unit": "N m"}
        return named_cause(name, {"amplitude_nm": size, "step_time_s": place})

    one, two = [cause("mains-hum", 0.1)], [cause("mains-hum", 0.2), cause("zero-step", 1.0)]
    sides = ({"verdict": "named", "causes": causes} for causes in (one, two))
    a, b = both(tmp_path, "diagnosis", *sides)
    found = compare_runs(a, b)
    assert found.moved == ("mains-hum.amplitude_nm", "only in B: zero-step")
    assert compare_runs(a, a).verdict == "within-uncertainty"


def test_two_kinds_are_refused_with_exit_4(tmp_path):
    a = store(tmp_path / "a.json", "misalignment", **misalignment(1.0))
    b = store(tmp_path / "b.json", "ripple", **ripple((2.0, 0.4, 0.1)))
    with pytest.raises(DataError, match="a ripple result against a misalignment result"):
        compare_runs(a, b)


@pytest.mark.parametrize(
    "damage",
    [
        *({"peak_to_peak_nm": value} for value in (3.0, {"value": 1.0}, q(1.0, -2.0))),
        {"after": [1]},
        {"torque_scale": {"gain_nm_per_v": {"value": "x"}}},
    ],
)
def test_a_misshapen_entry_is_named_and_no_bug(tmp_path, damage):
    good = store(tmp_path / "a.json", "misalignment", **misalignment(1.0))
    bad = store(tmp_path / "b.json", "misalignment", **{**misalignment(1.0), **damage})
    with pytest.raises(DataError) as caught:
        compare_runs(bad, bad)
    assert "b.json" in caught.value.where
    assert compare_runs(good, good).verdict == "within-uncertainty"


def test_other_files_are_refused(tmp_path):
    other = store(tmp_path / "o.json", "orders")
    with pytest.raises(DataError, match="schema"):
        compare_runs(other, other)
    (tmp_path / "run").mkdir()
    with pytest.raises(DataError, match=r"no result\.json"):
        compare_runs(tmp_path / "run", other)


def test_the_csv_holds_the_numbers_of_the_json(tmp_path):
    found = compare_runs(*both(tmp_path, "misalignment", misalignment(5.0), misalignment(0.9)))
    lines = comparison_csv(found).splitlines()
    cells = dict(zip(lines[0].split(","), lines[1].split(","), strict=True))
    body = found.to_dict()["quantities"][0]
    assert float(cells["difference"]) == body["difference"]["value"]
    assert float(cells["score"]) == body["score"]
    assert cells["moved"] == "true"


def with_loads(folder: Path, gain: float, zero_v: float) -> Path:
    """Write a calibration's run folder with three readings on one line."""
    result = calibration({0.0: gain, 2.0: gain, 4.0: gain}, 0.01)
    for line in result["experiments"]:
        line["zero_v"] = zero_v
    write_run(folder, "calibration", {**HEAD, **result}, profile={})
    rows = ["experiment,position_rad,range,direction,series,torque_nm,reading_v"]
    rows += [
        f"p{i},{2.0 * i},full,cw,up,{torque},{torque / gain + zero_v!r}"
        for i in range(3)
        for torque in (0.0, 10.0, 20.0)
    ]
    (folder / "loads.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_the_overlay_shows_readings_off_the_first_line(tmp_path):
    a = with_loads(tmp_path / "a", 6.6, 0.05)
    b = with_loads(tmp_path / "b", 6.0, -0.03)
    curves = compare_runs(a, b).overlay
    assert curves["a"]["y"] == pytest.approx([0.0] * 9, abs=1e-12)
    # a sensor of 6.0 N m/V read by 6.6 shows a tenth too much
    assert curves["b"]["y"] == pytest.approx([0.0, 1.0, 2.0] * 3, abs=1e-12)
    (b / "loads.csv").write_text("experiment,reading_v\n")
    found = compare_runs(a, b)
    assert found.overlay is None
    assert "cannot be read" in found.overlay_reason
    assert found.verdict == "moved"


def test_profile_and_environment_are_compared_key_by_key(tmp_path):
    profile = Path(__file__).parents[2] / "profiles" / "cim-tr-97-06.toml"
    text = profile.read_text()
    for name, wave, seed in (("a", text, "sim-0"), ("b", text.replace("46.0 ", "47.0 "), "sim-1")):
        more = {"profile": {"text": wave}, "device": {"serial": seed}, "hdbench_version": "0"}
        write_run(tmp_path / name, "misalignment", {**HEAD, **misalignment(1.0)}, **more)
    found = compare_runs(tmp_path / "a", tmp_path / "b").to_dict()
    assert found["profile_changes"] == [
        {"key": "drive.flexspline_diameter_mm", "a": 46.0, "b": 47.0, "only": ""}
    ]
    assert [change["key"] for change in found["environment_changes"]] == ["device.serial"]
