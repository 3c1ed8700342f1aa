"""A model that holds every kind of new cause leaves nothing to be found on its own record."""

import numpy as np

from hdbench.diagnosis import diagnose_trace
from hdbench.model import BenchModel, CauseTerm, simulate_run
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


def test_angle_errors_poles_and_friction_by_direction_are_explained_by_their_model():
    model = BenchModel.from_profile(PROFILE.data)
    for term in (
        CauseTerm("transmission-error", {}, (0.01, 0.0, 0.05, 0.02, 0.0, 0.01, 0.0)),
        CauseTerm("cogging", {"order": 12.0}, (0.1, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.02)),
        CauseTerm("asymmetric-friction", {}, (0.1, -0.002)),
    ):
        model = model.with_cause(term)
    trace = simulate_run(
        PROFILE.data,
        model,
        duration_s=20.0,
        wave=PROFILE.data.ripple.reference,
        noise_nm=0.05,
        rng=np.random.default_rng(3),
    )
    again = diagnose_trace(trace, PROFILE, model=model)
    assert again.verdict == "nothing-found"
