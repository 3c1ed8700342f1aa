"""Experiments on the emulated T7 find what its bench was built with."""

from dataclasses import replace

import pytest
from changing import with_keys

from hdbench.profile import load_profile
from hdbench.profile.schema import ReferenceWave
from hdbench.session import BenchOptions, run_experiment

T7 = load_profile("labjack-t7")
TRUTH = T7.data.model
WAVE = ReferenceWave(
    wave="trapezoid", amplitude_v=2.773, frequency_hz=0.25, duty=0.8, rise=0.1, fall=0.1
)
# a few seconds of motion
SHORT = {
    "misalignment": {"velocity_rad_s": 350.0},
    "ripple": {"duration_s": 4.0, "reference": WAVE},
}


@pytest.mark.usefixtures("patient_control")
@pytest.mark.parametrize(
    ("kind", "waves"),
    [("misalignment", (TRUTH.misalignment,)), ("ripple", TRUTH.ripple)],
    ids=["misalignment", "ripple"],
)
def test_an_experiment_runs_unchanged_and_finds_the_waves_of_the_bench(kind, waves, tmp_path):
    profile = replace(T7, data=with_keys(T7.data, **SHORT))
    outcome = run_experiment(kind, profile, BenchOptions(tmp_path, seed=21), lambda *_: None)
    assert outcome.doubts == ()
    result = outcome.result.to_json()
    lines = result["ripple"] if kind == "ripple" else [result]
    for found, true in zip(lines, waves, strict=True):
        assert found.get("order") == getattr(true, "order", None)
        for name in ("amplitude_nm", "phase_rad"):
            quantity = found[name]
            # five standard deviations
            assert abs(quantity["value"] - getattr(true, name)) < 5.0 * quantity["std"], name
