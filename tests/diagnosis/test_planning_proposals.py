"""A proposed run tells apart what the run at hand cannot."""

from dataclasses import replace

import pytest

from hdbench.diagnosis.planning import check_motion_plan, plan_for_causes
from hdbench.diagnosis.planning.blocks import full_protocol
from hdbench.diagnosis.planning.confusability import compare
from hdbench.diagnosis.planning.proposal import effects_named, propose, settled_by
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment, planned_motion
from hdbench.model import Motion, catalogue
from hdbench.profile import load_profile
from hdbench.results.diagnosis import Gain, NamedCause, ParameterValue

PROFILE = load_profile("cim-tr-97-06").data


def moved(*steps: Segment | LoadStep) -> Motion:
    return planned_motion(MotionPlan("at hand", steps), PROFILE)


START, STOP = Segment("ramp", 0.5, 156.0), Segment("ramp", 0.5)
RUNS = {
    "one speed": (START, Segment("hold", 29.0, 156.0), STOP),
    "one reversal": (
        START,
        Segment("hold", 9.0, 156.0),
        Segment("ramp", 1.0, -156.0),
        Segment("hold", 9.0, -156.0),
        STOP,
    ),
    "one ramp": (Segment("ramp", 30.0, 156.0), STOP),
    "one load": (LoadStep("hang 10 N m", 10.0), START, Segment("hold", 15.0, 156.0), STOP),
    "locked loads": tuple(
        step
        for torque in (5.0, 20.0, -5.0, -20.0)
        for step in (LoadStep("load", torque, locked=True), Segment("rest", 2.0))
    ),
}


# names, run on which they look alike, most of sin^2 there, least of it on the proposed run
LOOK_ALIKES = [
    ("viscous-friction", "zero-drift", "one ramp", 0.15, 0.5),
    # an exponential of 60 s is nearly a line over 30 s; the budget allows three time constants
    ("warm-up", "zero-drift", "one speed", 0.02, 0.05),
    ("position-dependent-gain", "gain-error", "locked loads", 0.01, 0.5),
]
MORE_LOOK_ALIKES = [
    ("wave-generator-eccentricity", "motor-unbalance", "one speed", 0.05, 0.4),
    ("coulomb-friction", "presliding", "one reversal", 0.01, 0.25),
    ("ripple-harmonic", "structural-tone", "one speed", 0.1, 0.5),
    ("coulomb-friction", "zero-step", "one reversal", 0.01, 0.5),
    ("load-dependent-ripple", "ripple-harmonic", "one load", 0.1, 0.5),
    ("inertia-error", "gain-error", "one speed", 0.01, 0.5),
]


@pytest.mark.parametrize(
    ("first", "second", "at_hand", "most", "least"),
    [
        *LOOK_ALIKES,
        *(pytest.param(*case, marks=pytest.mark.campaign) for case in MORE_LOOK_ALIKES),
    ],
)
def test_the_proposed_run_separates_what_the_run_at_hand_cannot(
    first, second, at_hand, most, least
):
    motion = moved(*RUNS[at_hand])
    found = propose(effects_named((first, second)), ((first, second),), PROFILE, at_hand=motion)
    (pair,) = found.pairs
    # None: the baseline holds the effect there, or the run does not show it at all
    assert pair.before is None or pair.before < most
    assert pair.after > least
    assert found.plan is not None
    assert check_motion_plan(found.plan, PROFILE) == []


def test_a_resonance_stands_out_of_the_kinematic_error_in_a_sweep_and_not_below_it():
    names = ("torsional-resonance", "kinematic-error")
    slow, fast = (
        compare(moved(Segment("sweep", 10.0, top)), effects_named(names), PROFILE, n_rows=3000)
        for top in (60.0, 380.0)
    )
    # far below its resonance the effect is the ripple of order 2 and 4 that the baseline holds
    assert slow.share(*names) is None
    assert fast.share(*names) > 0.5


def test_gravity_or_misalignment_gets_no_run_but_the_channel_that_settles_it():
    names = ("misalignment", "load-gravity")
    found = propose(effects_named(names), (names, names[::-1]), PROFILE)
    assert found.plan is None or not any(pair.separated for pair in found.pairs)
    known = catalogue()
    text = settled_by(known["misalignment"], known["load-gravity"])
    assert "motor_current_a" in text
    assert "load-gravity needs motor torque" in text


def test_without_an_operator_no_load_is_asked_for():
    names = ("ripple-harmonic", "structural-tone")
    found = propose(effects_named(names), (names,), PROFILE, loads=False)
    assert found.pairs[0].separated
    assert not found.plan.needs_operator
    assert not full_protocol(PROFILE, loads=False).needs_operator
    assert full_protocol(PROFILE).needs_operator


def test_the_full_protocol_lasts_as_long_as_that_of_the_literature_and_keeps_the_limits():
    for loads in (False, True):
        assert check_motion_plan(full_protocol(PROFILE, loads=loads), PROFILE) == []
    assert 160.0 < full_protocol(PROFILE, loads=False).duration_s < 185.0


def test_a_plan_for_a_diagnosis_takes_its_open_names_with_their_shapes():
    cause = NamedCause(
        name="structural-tone",
        group=("structural-tone", "ripple-harmonic"),
        parameters={
            "frequency_hz": ParameterValue(74.5, 0.01, "Hz"),
            "order": ParameterValue(3.0, 0.001, "1"),
            "amplitude_nm": ParameterValue(0.1, 0.001, "N m"),
        },
        evidence_nats=50.0,
        false_alarm_probability=0.0,
        gain=Gain(0.1, 0.05, 0.75, (0.7, 0.8)),
        share_of_variance=0.75,
        domain="frequency",
    )
    found = plan_for_causes([cause], PROFILE, motion=moved(*RUNS["one speed"]))
    assert found.plan is not None
    assert all(pair.separated for pair in found.pairs)
    assert {pair.first for pair in found.pairs} == {"structural-tone", "ripple-harmonic"}
    alone = replace(cause, group=("structural-tone",))
    assert plan_for_causes([alone], PROFILE) is None
