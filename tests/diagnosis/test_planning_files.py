"""Plan files are data: read back as written, refused with file and key, held against limits."""

import json
import math

import pytest

from hdbench.diagnosis.planning import check_motion_plan, read_plan, write_plan
from hdbench.diagnosis.planning.blocks import full_protocol
from hdbench.diagnosis.planning.planfile import plan_text
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.errors import DataError
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06").data
HEAD = 'schema = "hdbench/plan/1"\n'


@pytest.mark.parametrize("name", ["plan.toml", "plan.json"])
def test_a_plan_reads_back_as_it_was_written(tmp_path, name):
    plan = full_protocol(PROFILE)
    write_plan(tmp_path / name, plan)
    assert read_plan(tmp_path / name) == plan


def test_text_with_quotes_and_other_letters_survives():
    steps = (LoadStep('hang "5 kg" \\ Gewicht \u00fc', 2.0), Segment("rest", 1.0))
    text = plan_text(MotionPlan("a 'name'", steps))
    assert 'hang \\"5 kg\\" \\\\ Gewicht \u00fc' in text


@pytest.mark.parametrize(
    ("body", "key", "line", "needed"),
    [
        ('kind = "hold"\nspeed_rad_s = 1.0', "segments[0].duration_s", 2, "missing"),
        ('kind = "rest"\nduration_s = -1', "segments[0].duration_s", 4, "above 0"),
        ('kind = "rest"\nduration_s = nan', "segments[0].duration_s", 4, "above 0"),
        ('kind = "rest"\nduration_s = true', "segments[0].duration_s", 4, "a number"),
        ('kind = "rest"\nduration_s = 1e9', "segments[0].duration_s", 4, "86400 s"),
        ('kind = "jump"\nduration_s = 1', "segments[0].kind", 3, "one of hold"),
        ('kind = "rest"\nduration = 1', "segments[0].duration", 4, "did you mean 'duration_s'"),
        ('kind = "load"\ntext = "a\\nb"\ntorque_nm = 1', "segments[0].text", 4, "one line"),
        ('kind = "load"\ntext = "a"\ntorque_nm = 1\nlocked = 1', "segments[0].locked", 6, "true"),
    ],
)
def test_what_is_wrong_is_named_with_file_line_and_key(tmp_path, body, key, line, needed):
    path = tmp_path / "p.toml"
    path.write_text(f"{HEAD}[[segments]]\n{body}\n")
    with pytest.raises(DataError) as error:
        read_plan(path)
    problem = next(p for p in error.value.problems if f"key {key}:" in p.what)
    assert problem.where == f"{path}:{line}"
    assert needed in problem.what


@pytest.mark.parametrize(
    "text",
    ["", "not toml", 'schema = "hdbench/plan/2"\n', HEAD, HEAD + "segments = 3\n",
     HEAD + "segments = []\n", HEAD + "segments = [1]\n", "\x00", HEAD + "[[segments]]\n" * 1001],
)  # fmt: skip
def test_what_is_no_plan_is_refused_without_a_traceback(tmp_path, text):
    path = tmp_path / "p.toml"
    path.write_text(text)
    with pytest.raises(DataError) as error:
        read_plan(path)
    assert error.value.exit_code == 4
    assert str(path) in error.value.where


def test_a_json_plan_is_refused_by_key_too(tmp_path):
    path = tmp_path / "p.json"
    body = {"schema": "hdbench/plan/1", "segments": [{"kind": "ramp", "duration_s": 1}]}
    path.write_text(json.dumps(body))
    with pytest.raises(DataError, match=r"segments\[0\]\.speed_rad_s: missing"):
        read_plan(path)


@pytest.mark.parametrize(
    ("steps", "what"),
    [
        ((Segment("ramp", 1.0, 401.0), Segment("ramp", 1.0)), "motor speed 401 rad/s is above 400"),
        ((Segment("ramp", 0.01, 100.0), Segment("ramp", 1.0)), "acceleration 10000 rad/s^2"),
        ((Segment("hold", 1.0, 50.0),), "is a jump"),
        ((Segment("ramp", 1.0, 50.0),), "ends at 50 rad/s"),
        ((Segment("ramp", 1.0, 50.0), Segment("rest", 1.0)), "is a jump"),
        ((Segment("sine", 1.0, 10.0, 0.3),), "0.3 cycles"),
        ((Segment("sine", 1.0, 300.0, 2.0),), "acceleration"),
        ((Segment("rest", 601.0),), "duration 601 s is above 600"),
        ((LoadStep("too much", 61.0), Segment("rest", 1.0)), "torque 61 N m is above 60"),
        ((LoadStep("l", 1.0, locked=True), Segment("sine", 1.0, 1.0, 1.0)), "locked"),
        ((Segment("ramp", 1.0, 9.0), LoadStep("l", 1.0), Segment("ramp", 1.0)), "motor at rest"),
        ((Segment("ramp", 1.0, math.nan), Segment("ramp", 1.0)), "motor speed nan"),
        ((LoadStep("l", math.nan), Segment("rest", 1.0)), "torque nan"),
        ((LoadStep("l", 1.0),), "no segment"),
        ((Segment("rest", 1.0),) * 129, "129 parts"),
    ],
)
def test_whatever_leaves_a_limit_is_named(steps, what):
    problems = check_motion_plan(MotionPlan("p", steps), PROFILE)
    assert any(what in problem.what for problem in problems), [p.what for p in problems]
