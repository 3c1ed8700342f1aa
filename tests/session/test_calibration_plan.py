"""The sequence of a calibration is what the report and the guideline ask for."""

import json
import math
from collections import Counter

import pytest
from changing import with_keys
from fakes import WHOLE

from hdbench.errors import DataError
from hdbench.profile.calibrating import ShuntCheck
from hdbench.session.calibrating.plan import (
    calibration_plan,
    calibration_points,
    read_points,
    write_points,
)

PROFILE = WHOLE.data


def of(role: str, preset: str) -> list:
    return [point for point in calibration_points(PROFILE, preset) if point.role == role]


def test_the_report_s_sequence_has_positions_times_directions_times_ranges():
    readings = of("reading", "report")
    experiments = list(dict.fromkeys(point.experiment for point in readings))
    assert len(experiments) == 4 * 2 * 2
    assert len(readings) == 16 * 9
    assert of("preload", "report") == []
    assert calibration_points(PROFILE, "report")[0].role == "zero-check"


def test_every_series_begins_and_ends_without_weight_and_never_turns_back_halfway():
    for preset in ("report", "cg14"):
        readings = of("reading", preset)
        for name in dict.fromkeys(point.experiment for point in readings):
            masses = [p.mass_kg for p in readings if p.experiment == name]
            top = masses.index(max(masses))
            assert masses[0] == masses[-1] == 0.0
            assert masses[: top + 1] == sorted(set(masses))
            assert masses[top:] == sorted(set(masses), reverse=True)


def test_the_guideline_s_sequence_preloads_after_each_mounting_and_repeats_at_the_first():
    points = calibration_points(PROFILE, "cg14")
    order = list(dict.fromkeys((p.direction, p.position_index) for p in points[1:]))
    assert order == [("cw", 1), ("cw", 2), ("cw", 3), ("ccw", 1), ("ccw", 2), ("ccw", 3)]
    preloads = [p for p in of("preload", "cg14") if p.mass_kg > 0]
    preloaded = Counter((p.direction, p.position_index) for p in preloads)
    assert [preloaded[place] for place in order] == [3, 1, 1, 1, 1, 1]
    repeated = {p.experiment for p in points if p.repeat == 1}
    assert repeated == {"p1-cw-full-r2", "p1-ccw-full-r2"}
    readings = of("reading", "cg14")
    up = [p.mass_kg for p in readings if (p.experiment, p.series) == ("p2-cw-full", "up")]
    # 0, 20, 40, 60, 80 and 100 % of 8 kg
    assert up == pytest.approx([0.0, 1.6, 3.2, 4.8, 6.4, 8.0])
    assert {p.read_after_s for p in readings} == {30.0}
    assert {p.position_rad for p in points} == {0.0, 2 * math.pi / 3, 4 * math.pi / 3}


def test_the_plan_says_how_long_bench_and_person_take():
    plan = calibration_plan(PROFILE, "cg14")
    # 81 readings of 30 s and more, 16 preload steps of 30 s, one check of 2 s
    waits = [max(2.0, p.read_after_s) for p in plan.points]
    assert plan.duration_s == pytest.approx(sum(waits))
    assert plan.handling_s > plan.duration_s / 2
    assert plan.to_dict()["preset"] == "cg14"
    assert any("1.6 kg cw" in line for line in plan.lines())


def test_a_shunt_in_the_profile_is_checked_before_the_first_weight():
    shunt = ShuntCheck(resistor_ohm=87150.0)
    points = calibration_points(with_keys(PROFILE, calibration={"shunt": shunt}))
    assert [p.role for p in points[:3]] == ["zero-check", "shunt", "reading"]


def test_pan_and_hook_add_to_the_torque_of_a_weight_but_not_to_the_zero():
    points = calibration_points(with_keys(PROFILE, arm={"tare_kg": 0.2}), "report")
    torques = {p.mass_kg: p.torque_nm for p in points if p.experiment == "p1-cw-full"}
    assert torques[0.0] == 0.0
    assert torques[2.0] == pytest.approx(2.2 * 9.80650 * 0.5, rel=1e-12)


def test_the_stored_sequence_comes_back_as_it_was(tmp_path):
    points = calibration_points(PROFILE, "cg14")
    write_points(tmp_path, points, "cg14")
    assert read_points(tmp_path) == points


@pytest.mark.parametrize("damage", ["{}", '{"schema": "hdbench/calibration-plan/1"}', "[", ""])
def test_a_damaged_sequence_is_refused_and_named(tmp_path, damage):
    (tmp_path / "plan.json").write_text(damage)
    with pytest.raises(DataError) as error:
        read_points(tmp_path)
    assert "plan.json" in error.value.where


@pytest.mark.parametrize("key", ["number", "mass_kg", "experiment", "role"])
def test_a_point_that_lacks_a_key_is_refused(tmp_path, key):
    write_points(tmp_path, calibration_points(PROFILE), "report")
    whole = json.loads((tmp_path / "plan.json").read_text())
    for value in (None, True, [], "none"):
        whole["points"][2][key] = value
        if (key, value) != ("experiment", "none"):
            (tmp_path / "plan.json").write_text(json.dumps(whole))
            with pytest.raises(DataError, match=rf"2\.{key}"):
                read_points(tmp_path)


@pytest.mark.parametrize("change", [list.clear, list.reverse])
def test_a_sequence_that_is_not_in_order_is_refused(tmp_path, change):
    write_points(tmp_path, calibration_points(PROFILE), "report")
    whole = json.loads((tmp_path / "plan.json").read_text())
    change(whole["points"])
    (tmp_path / "plan.json").write_text(json.dumps(whole))
    with pytest.raises(DataError, match="not numbered in order"):
        read_points(tmp_path)
