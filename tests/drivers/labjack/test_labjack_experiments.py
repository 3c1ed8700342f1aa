"""Experiments on the emulated T7: the same bench as the node's, by their results."""

from dataclasses import replace
from pathlib import Path

import pytest
from changing import with_keys

from hdbench.profile import load_profile
from hdbench.profile.schema import ReferenceWave
from hdbench.session import BenchOptions, run_experiment

WAVE = ReferenceWave(
    wave="trapezoid", amplitude_v=2.773, frequency_hz=0.25, duty=0.8, rise=0.1, fall=0.1
)


def shortened(name: str):
    """Return a profile whose experiments take a few seconds."""
    profile = load_profile(name)
    ripple = {"duration_s": 4.0, "reference": WAVE}
    data = with_keys(profile.data, misalignment={"velocity_rad_s": 350.0}, ripple=ripple)
    return replace(profile, data=data)


def measured(kind: str, name: str, out: Path) -> dict:
    """Return the result of an experiment as it is kept."""
    options = BenchOptions(out=out / name, seed=21)
    outcome = run_experiment(kind, shortened(name), options, lambda *_: None)
    assert outcome.doubts == ()
    return outcome.result.to_json()


def agree(one: dict, other: dict) -> None:
    """Compare two numbers with uncertainties, five of their common standard deviations."""
    common = (one["std"] ** 2 + other["std"] ** 2) ** 0.5
    assert abs(one["value"] - other["value"]) < 5.0 * common


@pytest.mark.usefixtures("patient_control")
@pytest.mark.parametrize("kind", ["misalignment", "ripple"])
def test_an_experiment_runs_unchanged_and_agrees_with_the_nodes(kind, tmp_path):
    t7, node = (measured(kind, name, tmp_path) for name in ("labjack-t7", "cim-tr-97-06"))
    waves = [[result] if kind == "misalignment" else result["ripple"] for result in (t7, node)]
    for one, other in zip(*waves, strict=True):
        assert one.get("order") == other.get("order")
        agree(one["amplitude_nm"], other["amplitude_nm"])
        agree(one["phase_rad"], other["phase_rad"])
