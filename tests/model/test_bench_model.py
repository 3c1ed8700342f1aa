import math
from dataclasses import replace

import numpy as np
import pytest
from changing import with_keys

from hdbench.errors import DataError
from hdbench.model import (
    BenchModel,
    CauseTerm,
    baseline_columns,
    baseline_orders,
    catalogue,
    gauge_order_factor,
    term_torque_nm,
)
from hdbench.profile import ProfileData
from hdbench.profile.schema import HarmonicParameters


def test_the_model_is_exactly_what_the_profile_describes(bench, make_motion):
    motion = make_motion()
    got = BenchModel.from_profile(bench).torque_nm(motion)
    for k in range(0, len(motion), 13):
        a, o = float(motion.angle_rad[k]), float(motion.output_angle_rad[k])
        # the numbers of profiles/cim-tr-97-06.toml, by hand
        want = 1.725e-2 / 100 * float(motion.acceleration_rad_s2[k])
        want += 0.4 * math.cos(2 * a + 0.6) + 0.2 * math.cos(4 * a - 1.1)
        want += 0.9 * math.cos(o + 0.3) + float(motion.load_torque_nm[k])
        # angles up to 8000 rad: doubles 1e-12 apart
        assert got[k] == pytest.approx(want, rel=0, abs=1e-11)


def test_gauges_on_a_turning_flexspline_see_more_lobes(bench, turning):
    assert gauge_order_factor(bench.drive) == 1.0
    # after one motor turn the flexspline is 1/100 turn back: 2 lobes pass 1.01 times
    assert baseline_orders(bench) == (2.0, 4.0)
    assert baseline_orders(turning) == pytest.approx((2.02, 4.04), rel=1e-15, abs=0)
    orders = [order for order, _, _ in BenchModel.from_profile(turning).ripple]
    assert orders == pytest.approx([2.02, 4.04], rel=1e-15, abs=0)


def test_further_orders_of_the_profile_join_the_baseline_once(bench, turning):
    sixth = HarmonicParameters(order=6.0, amplitude_nm=0.1)

    def orders(base: ProfileData, **changes: object) -> tuple[float, ...]:
        return baseline_orders(with_keys(base, model=changes))

    assert orders(bench, ripple=(*bench.model.ripple, sixth)) == (2.0, 4.0, 6.0)
    assert orders(bench, ripple=()) == (2.0, 4.0)
    # a drive of another kind has orders of its own
    own = {"baseline_orders": (21.0, 7.0), "ripple": (sixth,)}
    assert orders(bench, **own) == (6.0, 7.0, 21.0)
    assert orders(turning, **own) == pytest.approx((6.06, 7.07, 21.21), rel=1e-15, abs=0)


def test_baseline_columns_are_those_of_the_contract(bench, make_motion):
    motion = make_motion(load_torque_nm=None)
    fixed, names, columns = baseline_columns(motion, bench)
    # one product and one quotient
    expected = 1.725e-4 * motion.acceleration_rad_s2
    np.testing.assert_allclose(fixed, expected, rtol=1e-15, atol=0)
    loaded = make_motion()
    for told, load in (({}, 1.0), ({"load": 0.0}, 0.0), ({"load": -1.0}, -1.0)):
        got = baseline_columns(loaded, bench, **told)[0]
        # and one sum of numbers below 32
        want = expected + load * loaded.load_torque_nm
        np.testing.assert_allclose(got, want, rtol=0, atol=8e-15)
    a, o = motion.angle_rad, motion.output_angle_rad
    want = {"zero": np.ones(len(motion))}
    for name, angle in (("ripple:2.0", 2 * a), ("ripple:4.0", 4 * a), ("misalignment", o)):
        want |= {f"{name}:cosine": np.cos(angle), f"{name}:sine": np.sin(angle)}
    assert names == tuple(want)
    assert (columns == np.column_stack(list(want.values()))).all()


@pytest.mark.parametrize(("span", "there"), [(2 * math.pi + 1e-9, True), (6.28, False)])
def test_output_order_one_needs_a_whole_output_turn(span, there, bench, make_motion):
    output = np.linspace(1.0, 1.0 + span, 400)
    _, names, _ = baseline_columns(make_motion(output_angle_rad=output), bench)
    assert ("misalignment:cosine" in names) == there


def test_a_fitted_baseline_gives_back_the_model_it_was_simulated_with(turning, make_motion):
    motion = make_motion(2000)
    truth = replace(
        BenchModel.from_profile(turning),
        zero_nm=-0.3,
        ripple=((2.02, 0.7, 2.0), (4.04, 0.1, -3.0)),
        misalignment=(1.5, 0.0),
    )
    torque = truth.torque_nm(motion)
    fixed, names, columns = baseline_columns(motion, turning)
    fit = np.linalg.lstsq(columns, torque - fixed, rcond=None)[0]
    found = BenchModel.from_profile(turning).with_baseline(names, fit.tolist())
    assert found.zero_nm == pytest.approx(-0.3, rel=0, abs=1e-10)
    # a well-conditioned fit of 2000 samples, angles of 8000 rad rounded to 1e-12
    np.testing.assert_allclose(found.ripple, truth.ripple, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.misalignment, (1.5, 0.0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.torque_nm(motion), torque, rtol=0, atol=1e-9)


def test_a_misalignment_that_was_not_fitted_is_in_the_zero(bench):
    model = BenchModel.from_profile(bench).with_baseline(["zero"], [0.5])
    assert model.zero_nm == 0.5
    assert model.misalignment == (0.0, 0.0)
    assert model.ripple == ()


@pytest.mark.parametrize(
    ("names", "values", "words"),
    [
        (["zero"], [math.nan], "finite"),
        (["zero", "offset"], [1.0, 2.0], "unknown baseline term 'offset'"),
        (["zero"], [1.0, 2.0], "shorter|longer"),
    ],
)
def test_a_fit_that_is_none_is_refused(names, values, words, bench):
    with pytest.raises(ValueError, match=words):
        BenchModel.from_profile(bench).with_baseline(names, values)


def test_causes_add_up_and_stand_in_the_terms(bench, make_motion):
    motion = make_motion()
    hum = CauseTerm("mains-hum", {"frequency_hz": 50.0}, (0.3, 0.4))
    drag = CauseTerm("viscous-friction", {}, (0.002,))
    base = BenchModel.from_profile(bench)
    model = base.with_cause(hum).with_cause(drag)
    want = 0.5 * np.cos(100 * np.pi * motion.time_s - math.atan2(0.4, 0.3))
    want += 0.002 * motion.velocity_rad_s
    # phases of the hum up to 1000 rad: doubles 1e-13 apart
    for got in (model.cause_torque_nm(motion), model.torque_nm(motion) - base.torque_nm(motion)):
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)
    terms = "zero expected-torque load ripple-2 ripple-4 misalignment mains-hum viscous-friction"
    assert " ".join(model.terms()) == terms
    assert base.causes == ()


def test_the_load_counts_by_its_coefficient(bench, make_motion):
    motion = make_motion()
    model = BenchModel.from_profile(bench)
    without = model.torque_nm(make_motion(load_torque_nm=None))
    for load in (1.0, 0.0, -1.0):
        got = replace(model, load=load).torque_nm(motion)
        # sums of a few numbers below 32
        np.testing.assert_allclose(got, without + load * motion.load_torque_nm, rtol=0, atol=2e-14)
    assert "load" not in replace(model, load=0.0).terms()


def test_what_acts_on_the_whole_signal_sees_baseline_load_and_causes(bench, make_motion):
    motion = make_motion()
    base = BenchModel.from_profile(bench)
    hum = CauseTerm("mains-hum", {"frequency_hz": 50.0}, (0.3, 0.4))
    limited = CauseTerm("saturation", {"limit_nm": 20.0, "sharpness": 1.0}, (1.0,))
    want = 20.0 * np.tanh(base.with_cause(hum).torque_nm(motion) / 20.0)
    for one, other in ((limited, hum), (hum, limited)):
        got = base.with_cause(one).with_cause(other).torque_nm(motion)
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["gain-error", "cubic-nonlinearity", "direction-asymmetry"])
def test_without_a_measured_load_the_torque_is_the_expected_one(name, make_motion):
    term = CauseTerm(name, {}, (0.1,))
    free = make_motion(load_torque_nm=None)
    load = 1.725e-4 * free.acceleration_rad_s2
    expected = make_motion(load_torque_nm=load, inertia_nm_s2=0.0)
    got, want = term_torque_nm(term, free), term_torque_nm(term, expected)
    np.testing.assert_allclose(got, want, rtol=1e-13)


def test_columns_of_another_shape_are_refused(make_motion):
    base = catalogue()["zero-drift"]
    own = replace(base, name="own", columns=lambda motion, shape: np.ones(len(motion)))
    with pytest.raises(DataError, match=r"shape \(400,\); needed: \(400, 1\)"):
        term_torque_nm(CauseTerm("own", {}, (1.0,)), make_motion(), extra=(own,))


def test_a_term_that_does_not_fit_never_enters_a_model(bench, make_motion):
    with pytest.raises(DataError, match="unknown cause 'hum'"):
        BenchModel.from_profile(bench).with_cause(CauseTerm("hum", {}, (1.0,)))
    with pytest.raises(DataError, match="frequency_hz of mains-hum is 55"):
        term_torque_nm(CauseTerm("mains-hum", {"frequency_hz": 55.0}, (1.0, 0.0)), make_motion())
