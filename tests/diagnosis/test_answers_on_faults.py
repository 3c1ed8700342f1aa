"""Answers on records with faults of the acquisition: named, measured, and no effect is lost."""

import numpy as np
import pytest
from swinging_shaft import COUNT, slipped
from swinging_shaft import read_by_encoder as bench

from hdbench.diagnosis import diagnose_trace
from hdbench.model import load_model, save_model
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")


def changed(columns, **new):
    return Trace({**columns, **new})


def every(result):
    return {c.name: c for c in (*result.minor, *result.causes)}


def test_a_slip_is_named_modelled_and_an_effect_beside_it_is_still_found(tmp_path):
    columns = bench(6000, seed=8, extra=lambda t, a, w: 0.08 * np.cos(6 * a))
    trace = Trace(slipped(columns, (3000, 150)))
    result = diagnose_trace(trace, PROFILE)
    assert [c.name for c in result.causes] == ["encoder-slip", "ripple-harmonic"]
    slip, ripple = result.causes
    parameters = slip.parameters
    assert parameters["slip_rad"].value == pytest.approx(150 * COUNT, abs=COUNT)
    assert 2.999 <= parameters["step_time_s"].value <= 3.0
    assert ripple.parameters["order"].value == pytest.approx(6.0, abs=0.01)
    assert ripple.parameters["amplitude_nm"].value == pytest.approx(0.08, abs=0.004)
    # without the slip the residual is that of ripple and noise
    wanted = float(np.hypot(0.05, 0.08 / np.sqrt(2.0)))
    assert slip.gain.heldout_rms_after_nm == pytest.approx(wanted, rel=0.03)
    assert slip.gain.interval[0] > 0.0
    assert "encoder-slip" in {flag.name for flag in result.data_flags}
    save_model(tmp_path / "model.json", result.model, profile=PROFILE, provenance={})
    again = diagnose_trace(trace, PROFILE, model=load_model(tmp_path / "model.json"))
    assert again.verdict == "nothing-found"


def test_spikes_and_gaps_are_named_with_what_they_cost():
    columns = bench(6000, seed=11)
    torque = columns["torque_nm"].copy()
    at = np.array([900, 2100, 2101, 4444])
    torque[at] += (1.0, -1.2, -0.9, 0.8)
    kept = np.r_[0:3000, 3050:6000]
    trace = Trace({k: v[kept] for k, v in (columns | {"torque_nm": torque}).items()})
    result = diagnose_trace(trace, PROFILE)
    assert [c.name for c in result.causes] == ["spikes"]
    (spikes,) = result.causes
    assert spikes.parameters["samples"].value == 4.0
    # 3.89 (N m)^2 of spikes over the noise of 5950 samples
    share = 3.89 / (3.89 + 5950 * 0.05**2)
    assert spikes.share_of_variance == pytest.approx(share, abs=0.03)
    gap = every(result)["missed-samples"]
    assert (gap.parameters["samples"].value, gap.share_of_variance) == (50.0, 0.0)
    assert {f.name: f.samples for f in result.data_flags} == {"spikes": 4, "missed-samples": 50}


def test_progress_rises_to_one_and_names_the_step():
    seen = []
    diagnose_trace(
        Trace(bench(4000)), PROFILE, progress=lambda what, share: seen.append((what, share))
    )
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len({what for what, _ in seen}) >= 6
