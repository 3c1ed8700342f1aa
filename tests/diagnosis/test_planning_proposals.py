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


def separating_plan(names: tuple[str, ...], *, loads: bool = True) -> MotionPlan | None:
    """Return the run that tells names apart; None where none of this bench does."""
    pairs = tuple((a, b) for a in names for b in names if a != b)
    found = propose(effects_named(names), pairs, PROFILE, loads=loads)
    return found.plan if any(pair.separated for pair in found.pairs) else None


def moved(*steps: Segment | LoadStep) -> Motion:
    return planned_motion(MotionPlan("at hand", steps), PROFILE)


def one_speed() -> Motion:
    return moved(Segment("ramp", 0.5, 156.0), Segment("hold", 29.0, 156.0), Segment("ramp", 0.5))


def one_reversal() -> Motion:
    return moved(
        Segment("ramp", 0.5, 156.0),
        Segment("hold", 9.0, 156.0),
        Segment("ramp", 1.0, -156.0),
        Segment("hold", 9.0, -156.0),
        Segment("ramp", 0.5),
    )


def one_ramp() -> Motion:
    return moved(Segment("ramp", 30.0, 156.0), Segment("ramp", 0.5))


def one_load() -> Motion:
    return moved(
        LoadStep("hang 10 N m", 10.0),
        Segment("ramp", 0.5, 156.0),
        Segment("hold", 15.0, 156.0),
        Segment("ramp", 0.5),
    )


def one_locked_load() -> Motion:
    return moved(
        *(
            step
            for torque in (5.0, 20.0, -5.0, -20.0)
            for step in (LoadStep("load", torque, locked=True), Segment("rest", 2.0))
        )
    )


# names, run on which they look alike, most of sin^2 there, least of it on the proposed run
LOOK_ALIKES = [
    ("viscous-friction", "zero-drift", one_ramp, 0.15, 0.5),
    # an exponential of 60 s is nearly a line over 30 s; the budget allows three time constants
    ("warm-up", "zero-drift", one_speed, 0.02, 0.05),
    ("position-dependent-gain", "gain-error", one_locked_load, 0.01, 0.5),
]
MORE_LOOK_ALIKES = [
    ("wave-generator-eccentricity", "motor-unbalance", one_speed, 0.05, 0.4),
    ("coulomb-friction", "presliding", one_reversal, 0.01, 0.25),
    ("ripple-harmonic", "structural-tone", one_speed, 0.1, 0.5),
    ("coulomb-friction", "zero-step", one_reversal, 0.01, 0.5),
    ("load-dependent-ripple", "ripple-harmonic", one_load, 0.1, 0.5),
    ("inertia-error", "gain-error", one_speed, 0.01, 0.5),
]


@pytest.mark.parametrize(
    ("first", "second", "at_hand", "most", "least"),
    [
        *LOOK_ALIKES,
        *(pytest.param(*case, marks=pytest.mark.campaign) for case in MORE_LOOK_ALIKES),
    ],
    ids=lambda x: getattr(x, "__name__", str(x)),
)  # fmt: skip
def test_the_proposed_run_separates_what_the_run_at_hand_cannot(
    first, second, at_hand, most, least
):
    found = propose(effects_named((first, second)), ((first, second),), PROFILE, at_hand=at_hand())
    (pair,) = found.pairs
    # None: the baseline holds the effect there, or the run does not show it at all
    assert pair.before is None or pair.before < most
    assert pair.after is not None
    assert pair.after > least
    assert found.plan is not None
    assert check_motion_plan(found.plan, PROFILE) == []


def test_a_resonance_stands_out_of_the_kinematic_error_in_a_sweep_and_not_below_it():
    names = ("torsional-resonance", "kinematic-error")
    slow = moved(Segment("sweep", 10.0, 60.0))
    sweep = moved(Segment("sweep", 10.0, 380.0))
    shares = [
        compare(motion, effects_named(names), PROFILE, n_rows=3000).share(*names)
        for motion in (slow, sweep)
    ]
    # far below its resonance the effect is the ripple of order 2 and 4 that the baseline holds
    assert shares[0] is None
    assert shares[1] is not None
    assert shares[1] > 0.5


def test_gravity_or_misalignment_gets_no_run_but_the_channel_that_settles_it():
    assert separating_plan(("misalignment", "load-gravity")) is None
    known = catalogue()
    text = settled_by(known["misalignment"], known["load-gravity"])
    assert "motor_current_a" in text
    assert "load-gravity needs motor torque" in text


def test_without_an_operator_no_load_is_asked_for():
    plan = separating_plan(("ripple-harmonic", "structural-tone"), loads=False)
    assert not plan.needs_operator
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
    found = plan_for_causes([cause], PROFILE, motion=one_speed())
    assert found.plan is not None
    assert all(pair.separated for pair in found.pairs)
    assert {pair.first for pair in found.pairs} == {"structural-tone", "ripple-harmonic"}
    alone = replace(cause, group=("structural-tone",))
    assert plan_for_causes([alone], PROFILE) is None
