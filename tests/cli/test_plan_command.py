"""`hdbench plan` says what a run tells apart and writes the run that does."""

import json
from pathlib import Path

from hdbench.diagnosis.planning import read_plan


def test_a_proposed_plan_is_written_and_passes_the_limits(tmp_path, answer):
    out = tmp_path / "p.toml"
    causes = ("--cause", "coulomb-friction", "--cause", "zero-step")
    body = answer("plan", *causes, "--no-loads", "--out", out)
    assert body["schema"] == "hdbench/plan-report/1"
    assert body["command"] == f"hdbench run-ripple --plan {out}"
    assert body["needs_operator"] is False
    assert all(pair["separated"] for pair in body["pairs"])
    assert read_plan(out).duration_s <= 180.0
    dry = answer("run-ripple", "--plan", out, "--dry-run")
    assert dry["plan"]["motion"]["name"] == body["plan"]["name"]


def test_inseparable_causes_get_no_plan_but_what_settles_them(tmp_path, hdbench):
    words = ("plan", "--cause", "misalignment", "--cause", "load-gravity", "--duration", 60)
    shown = hdbench(*words)[0]
    assert "NOT told apart" in shown
    assert "motor_current_a" in shown
    assert "no run of this bench" in shown
    told = hdbench(*words, "--out", tmp_path / "p.toml", code=2)[1]
    assert "no plan file was written" in told
    assert not (tmp_path / "p.toml").exists()


def test_one_screen_names_pairs_run_and_command(tmp_path, hdbench):
    out = tmp_path / "p.toml"
    words = ("--cause", "motor-unbalance", "--cause", "wave-generator-eccentricity")
    shown = hdbench("plan", *words, "--no-loads", "--out", out)[0]
    assert "told apart" in shown
    assert "proposed run:" in shown
    assert "run-ripple --plan" in shown
    assert len(shown.splitlines()) <= 40


def test_a_plan_with_loads_is_refused_without_a_person(tmp_path, hdbench):
    out = tmp_path / "p.toml"
    out.write_text(
        'schema = "hdbench/plan/1"\n[[segments]]\nkind = "load"\ntext = "hang 2 kg"\n'
        'torque_nm = 9.8\n[[segments]]\nkind = "rest"\nduration_s = 1.0\n'
    )
    words = ("run-ripple", "--plan", out, "--yes", "--no-input", "--out", tmp_path / "runs")
    told = hdbench(*words, code=2)[1]
    assert "needs an operator" in told
    assert "hang 2 kg" in told
    assert not (tmp_path / "runs").exists()


def test_wrong_input_is_told_in_words(tmp_path, hdbench):
    assert "nearest is" in hdbench("plan", "--cause", "ripple", code=4)[1]
    words = ("plan", "--cause", "coulomb-friction", "--protocol", "x")
    assert "needed: full" in hdbench(*words, code=2)[1]
    bad = tmp_path / "p.toml"
    bad.write_text('schema = "hdbench/plan/1"\n[[segments]]\nkind = "rest"\n')
    told = hdbench("run-ripple", "--plan", bad, "--dry-run", code=4)[1]
    assert "segments[0].duration_s" in told
    fast = tmp_path / "f.toml"
    fast.write_text(
        'schema = "hdbench/plan/1"\n[[segments]]\nkind = "ramp"\nspeed_rad_s = 900\n'
        'duration_s = 9\n[[segments]]\nkind = "ramp"\nspeed_rad_s = 0\nduration_s = 9\n'
    )
    told = hdbench("run-ripple", "--plan", fast, "--dry-run", code=2)[1]
    assert "motor speed 900 rad/s is above 400" in told


def test_what_a_diagnosis_leaves_open_is_planned_with_its_noise(
    tmp_path, hdbench, named_cause, answer
):
    frequency_hz = {"value": 74.5, "std": None, "unit": "Hz"}
    order = {"value": 3.0, "std": None, "unit": "1"}
    shape = {"frequency_hz": frequency_hz, "order": order}
    file = tmp_path / "result.json"

    def diagnosed(noise: object, *rivals: str) -> Path:
        cause = named_cause("structural-tone", shape, group=["structural-tone", *rivals])
        body = {"verdict": "named", "causes": [cause], "settings": {"noise": noise}}
        file.write_text(json.dumps({"schema": "hdbench/diagnosis/1", **body}))
        return file

    falling = {"frequency_hz": [0.1, 1.0, 500.0], "power_nm2": [0.1, 1e-3, 1e-4]}
    for noise in ({"std_nm": 0.02}, falling):
        words = ("plan", "--for", diagnosed(noise, "ripple-harmonic"), "--duration", 30)
        pairs = answer(*words, "--no-loads")["pairs"]
        assert {pair["first"] for pair in pairs} == {"structural-tone", "ripple-harmonic"}
        assert all(pair["separated"] for pair in pairs)
    for broken in ({"std_nm": 0.0}, {"frequency_hz": [1.0]}, 3):
        words = ("plan", "--for", diagnosed(broken, "ripple-harmonic"))
        assert "settings.noise" in hdbench(*words, code=4)[1]
    assert "nothing is open" in hdbench("plan", "--for", diagnosed(None), code=2)[1]
