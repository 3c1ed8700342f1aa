"""Two causes that hide each other, and a step so strong that it bends its own noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from hdbench.diagnosis import diagnose_trace, search
from hdbench.diagnosis.fit import swap
from hdbench.diagnosis.fit.pairs import Pair
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.naming import renaming
from hdbench.diagnosis.naming.candidates import Candidate
from hdbench.diagnosis.naming.curves import CURVE_PREFIX
from hdbench.model import catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05


def loaded_trace(seed, extra):
    """Speed that reverses under a load of both signs."""
    n, rng = 16_000, np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    rate = 2.0 * np.pi / 4.0
    speed, angle = 60.0 * np.sin(rate * time), 60.0 / rate * (1.0 - np.cos(rate * time))
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7)
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + load
    torque += 1.725e-4 * 60.0 * rate * np.cos(rate * time) + extra(time, load)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "load_torque_nm": load,
        "torque_nm": torque + NOISE_NM * rng.standard_normal(n),
    }
    return Trace(columns)


def test_a_gain_error_and_a_cube_that_nearly_cancel_are_both_named():
    def bent(_time, load):
        # of a sine the cube keeps three quarters at its own rate
        return 0.05 * (4.0 / 3.0 * (load / 20.0) ** 3 - load / 20.0)

    found = diagnose_trace(loaded_trace(3, bent), PROFILE, materiality=0.0)
    names = {name for cause in found.causes for name in (cause.name, *cause.group)}
    assert len(found.causes) == 2
    assert {"gain-error", "cubic-nonlinearity"} <= names
    assert found.unexplained == ()


@pytest.mark.parametrize(("pole", "noise_nm"), [(0.0, 0.05), (0.9, 0.01)])
def test_a_cube_and_an_asymmetry_are_two_names_and_no_table_however_strong(pole, noise_nm):
    noise = np.random.default_rng(5).standard_normal(16_000)
    noise = noise_nm * signal.lfilter([1.0], [1.0, -pole], noise)
    trace = loaded_trace(3, lambda _time, load: 3e-4 * load**3 + 0.04 * np.abs(load) + noise)
    quiet = np.random.default_rng(3).standard_normal(16_000)
    trace = trace.with_columns(torque_nm=trace["torque_nm"] - NOISE_NM * quiet)
    found = diagnose_trace(trace, PROFILE)
    names = [{cause.name, *cause.group} for cause in found.causes]
    assert len(names) == 2
    assert any("cubic-nonlinearity" in one for one in names)
    assert any(one & {"direction-asymmetry", "side-force"} for one in names)
    assert found.unexplained == ()


def test_a_large_step_with_a_slope_is_a_step():
    def slope(time, _load):
        return 2.0 * np.clip((time - 7.0) / 0.03, 0.0, 1.0)

    found = diagnose_trace(loaded_trace(4, slope), PROFILE)
    assert [cause.name for cause in found.causes] == ["zero-step"]
    (cause,) = found.causes
    assert abs(cause.parameters["step_nm"]["value"] - 2.0) < 0.02


@pytest.mark.parametrize(("more_nats", "swapped"), [(3.0, False), (4.5, False), (4.7, True)])
def test_one_name_gives_way_to_two_only_where_the_second_is_as_sure_as_a_finding(
    monkeypatch, more_nats, swapped
):
    states = []
    monkeypatch.setattr(search, "swap_for_pair", lambda state, alpha: states.append(state))
    diagnose_trace(loaded_trace(5, lambda _t, load: 0.02 * load), PROFILE)
    (state,) = states
    assert [one.name for one in state.accepted] == ["gain-error"]
    present = swap.nats(state.fit, state.noise) - swap._paid(list(state.fit.terms))
    terms = tuple(Term(catalogue()[name], {}) for name in ("gain-error", "cubic-nonlinearity"))
    pair = Pair(terms, 1.0, 0.0, 10.0)
    monkeypatch.setattr(swap, "_pairs_beside", lambda *_: [pair])
    monkeypatch.setattr(swap, "_worth", lambda *_: present + swap._picked(pair, 1) + more_nats)
    # odds of a finding at a false-alarm rate of 1 %: ln 100 = 4.605 nats
    assert swap.swap_for_pair(state, 0.01) is swapped
    assert len(state.accepted) == (2 if swapped else 1)


def test_what_a_pair_of_names_makes_needless_goes(monkeypatch):
    swap_for_pair = search.swap_for_pair

    def with_a_leftover(state, alpha):
        step = Term(catalogue()["zero-step"], {"step_time_s": 3.0})
        state.accepted.insert(0, replace(state.accepted[0], name="zero-step", group=(step,)))
        state.settle((step, *state.fit.terms))
        return swap_for_pair(state, alpha) or True

    monkeypatch.setattr(search, "swap_for_pair", with_a_leftover)
    found = diagnose_trace(loaded_trace(6, lambda _t, load: 0.02 * load), PROFILE)
    assert [cause.name for cause in (*found.causes, *found.minor)] == ["gain-error"]


@pytest.mark.parametrize(("named_nats", "first"), [(7.1, "gain-error"), (6.9, "nameless")])
def test_a_place_without_a_name_needs_three_nats_more_than_one(named_nats, first):
    cause = catalogue()["gain-error"]
    bare = Term(replace(cause, name=CURVE_PREFIX + "torque"), {})
    ranked = [Candidate(bare, 40.0, 8, 10.0), Candidate(Term(cause, {}), 30.0, 1, named_nats)]
    (best, _) = renaming._names_first(ranked)
    assert (best.term is bare) == (first == "nameless")


@pytest.mark.parametrize(("left_nats", "gone"), [(2.9, 1), (3.1, 0)])
def test_a_cause_with_hardly_any_evidence_beside_better_names_goes(monkeypatch, left_nats, gone):
    states = []
    monkeypatch.setattr(search, "rename_all", states.append)
    diagnose_trace(loaded_trace(7, lambda t, load: 0.02 * load + 0.1 * (t > 8.0)), PROFILE)
    (state,) = states
    before = len(state.accepted)
    assert before > 1
    state.accepted[0] = replace(state.accepted[0], evidence_nats=left_nats)
    state.accepted[1:] = [replace(one, evidence_nats=50.0) for one in state.accepted[1:]]
    kept = state.accepted[gone:]
    renaming._drop_unsure(state)
    assert state.accepted == kept
    assert len(state.fit.terms) == before - gone
