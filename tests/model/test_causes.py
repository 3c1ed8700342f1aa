import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdbench import model
from hdbench.errors import DataError

Shape = dict[str, float]

CONTRACT_LIST = """
ripple-harmonic wave-generator-eccentricity motor-unbalance load-dependent-ripple
torsional-resonance ripple-beat kinematic-error tooth-mesh bearing-defect gain-ripple cogging
transmission-error
misalignment angular-misalignment load-gravity position-dependent-gain mains-hum
structural-tone coulomb-friction viscous-friction stribeck-friction load-dependent-friction
presliding asymmetric-friction gain-error cubic-nonlinearity hysteresis backlash saturation arm-sag
side-force direction-asymmetry inertia-error time-skew cubic-stiffness piecewise-stiffness zero-step
zero-drift warm-up creep zero-random-walk quantisation missed-samples encoder-slip tacho-ripple
spikes speed-dependent-noise crosstalk
"""
CONTRACT_NAMES = set(CONTRACT_LIST.split())
J = 1.725e-2


def tone(t: float, s: Shape, **_: float) -> list[float]:
    return wave(2 * math.pi * s["frequency_hz"] * t)


def wave(x: float, size: float = 1.0) -> list[float]:
    return [size * math.cos(x), size * math.sin(x)]


def second_derivative(k: int, a: float, w: float, alpha: float) -> list[float]:
    """Return J times the second derivative over time of cos(k a) and sin(k a)."""
    cosine = -k * k * w * w * math.cos(k * a) - k * alpha * math.sin(k * a)
    sine = -k * k * w * w * math.sin(k * a) + k * alpha * math.cos(k * a)
    return [J * cosine, J * sine]


def size(w: float) -> float:
    return math.sqrt(w * w)


# shape parameters to try, and the torque per unit of each linear parameter at one sample, in the
# plain numbers t, w, a (motor angle), o (output angle), alpha, tau (load and expected torque), u
# (current), g (gauge factor) and r (slope of the ripple); the record starts at t0. Causes that
# remember have no such formula
BY_HAND: dict[str, tuple[Shape, Callable[..., list[float]]]] = {
    "ripple-harmonic": ({"order": 3.37}, lambda a, s, **_: wave(s["order"] * a)),
    "wave-generator-eccentricity": ({}, lambda a, **_: wave(a)),
    "motor-unbalance": ({}, lambda a, w, **_: wave(a, w * w / 1e4)),
    "load-dependent-ripple": ({}, lambda a, g, tau, **_: wave(2 * g * a, abs(tau) / 10)),
    "gain-ripple": ({}, lambda a, g, tau, **_: wave(2 * g * a, tau / 10)),
    "kinematic-error": (
        {},
        lambda a, w, alpha, **_: [x for k in (1, 2, 4) for x in second_derivative(k, a, w, alpha)],
    ),
    "ripple-beat": ({}, lambda a, g, o, **_: wave(2 * g * a - o) + wave(2 * g * a + o)),
    "tooth-mesh": ({}, lambda a, **_: wave(202 * a)),
    "bearing-defect": (
        {"order": 4.95},
        lambda a, s, **_: [x for k in (1, 2, 3) for x in wave(k * s["order"] * a)],
    ),
    "cogging": ({"order": 12.0}, lambda a, **_: [x for k in (12, 24, 36, 72) for x in wave(k * a)]),
    "transmission-error": (
        {},
        lambda a, o, r, tau, **_: wave(a, -r) + wave(o, -r) + wave(2 * o, -r) + [-r * tau],
    ),
    "misalignment": ({}, lambda o, **_: wave(o)),
    "angular-misalignment": ({}, lambda o, **_: wave(2 * o)),
    "load-gravity": ({}, lambda o, **_: wave(o)),
    "position-dependent-gain": ({}, lambda o, tau, **_: wave(o, tau / 10) + wave(2 * o, tau / 10)),
    "mains-hum": ({"frequency_hz": 49.98}, tone),
    "structural-tone": ({"frequency_hz": 37.0}, tone),
    "coulomb-friction": (
        {"transition_rad_s": 2.0},
        lambda w, s, **_: [1 - 2 / (math.exp(2 * w / s["transition_rad_s"]) + 1)],
    ),
    "viscous-friction": ({}, lambda w, **_: [w]),
    "asymmetric-friction": ({}, lambda w, **_: [1 - 2 / (math.exp(4 * size(w)) + 1), size(w)]),
    "stribeck-friction": (
        # the sign is whole before the excess falls: it turns over within a fifth of 15 rad/s
        {"stribeck_rad_s": 15.0, "transition_rad_s": 8.0},
        lambda w, s, **_: [math.tanh(w / 3.0) / math.exp((w / s["stribeck_rad_s"]) ** 2)],
    ),
    "load-dependent-friction": (
        {"transition_rad_s": 3.0},
        lambda tau, w, **_: [abs(tau) * math.tanh(w / 3.0)],
    ),
    "inertia-error": ({}, lambda alpha, **_: [alpha / 100]),
    "gain-error": ({}, lambda tau, **_: [tau]),
    "cubic-nonlinearity": ({}, lambda tau, **_: [tau * tau * tau / 1000]),
    "backlash": ({"play_nm": 4.0}, lambda tau, **_: [-max(-4.0, min(4.0, tau))]),
    "saturation": (
        {"limit_nm": 25.0, "sharpness": 3.0},
        lambda tau, **_: [math.copysign(25 * math.tanh(abs(tau / 25) ** 3) ** (1 / 3), tau) - tau],
    ),
    "arm-sag": ({}, lambda o, tau, **_: wave(2 * o, tau * tau / 100)),
    "side-force": ({}, lambda tau, **_: [abs(tau) / 10]),
    "direction-asymmetry": ({}, lambda tau, **_: [abs(tau)]),
    "crosstalk": ({}, lambda u, **_: [u]),
    "zero-step": ({"step_time_s": 3.2}, lambda t, s, **_: [float(t >= s["step_time_s"])]),
    "zero-drift": ({}, lambda t, t0, **_: [t - t0]),
    "warm-up": (
        {"time_constant_s": 7.0},
        lambda t, t0, s, **_: [1 - math.exp(-(t - t0) / s["time_constant_s"])],
    ),
}


# held against brute force and integrated equations of motion in test_causes_that_remember.py
REMEMBER = {
    "torsional-resonance", "presliding", "hysteresis", "creep", "time-skew", "cubic-stiffness",
    "piecewise-stiffness",
}  # fmt: skip
# no torque: test_causes_of_the_acquisition.py
NO_TORQUE = {
    "zero-random-walk", "quantisation", "missed-samples", "encoder-slip", "tacho-ripple", "spikes",
    "speed-dependent-noise",
}  # fmt: skip


def test_the_catalogue_is_the_contract_in_its_order():
    assert list(model.catalogue()) == CONTRACT_LIST.split()
    assert len(CONTRACT_NAMES) == 48


def test_every_cause_is_checked_somewhere():
    assert set(BY_HAND) | REMEMBER | NO_TORQUE == CONTRACT_NAMES
    assert {name for name, cause in model.catalogue().items() if not cause.additive} == NO_TORQUE


@pytest.mark.parametrize("gauge", [1.0, 1.01])
@pytest.mark.parametrize("name", BY_HAND)
def test_columns_follow_the_equation(name, gauge, make_motion):
    motion = make_motion(gauge_factor=gauge)
    shape, formula = BY_HAND[name]
    got = model.catalogue()[name].columns(motion, shape)
    assert got.shape == (len(motion), len(model.catalogue()[name].linear))
    for k in range(0, len(motion), 7):
        want = formula(
            t=float(motion.time_s[k]),
            t0=float(motion.time_s[0]),
            w=float(motion.velocity_rad_s[k]),
            a=float(motion.angle_rad[k]),
            o=float(motion.output_angle_rad[k]),
            alpha=float(motion.acceleration_rad_s2[k]),
            tau=float(motion.load_torque_nm[k] + J / 100 * motion.acceleration_rad_s2[k]),
            u=float(motion.motor_current_a[k]),
            g=gauge,
            r=float(motion.ripple_slope_nm_per_rad[k]),
            s=shape,
        )
        # the angle of order 202 reaches 4e5 rad, where doubles are 6e-11 apart; products of three
        # factors may be rounded in another order, and a saturation is a difference of two numbers
        np.testing.assert_allclose(got[k], want, rtol=1e-12, atol=2e-10)


@pytest.mark.parametrize("cause", model.catalogue().values(), ids=lambda cause: cause.name)
def test_a_record_of_the_catalogue_is_complete(cause):
    for text in (cause.equation, cause.parity, cause.experiment, cause.source):
        assert text.strip()
    assert cause.locked_to in {
        "motor", "output", "clock", "velocity", "acceleration", "load", "current", "time"
    }  # fmt: skip
    assert cause.channel in {"sensor", "mechanical", "acquisition", "kinematic"}
    assert cause.look_alikes
    assert set(cause.look_alikes) <= CONTRACT_NAMES - {cause.name}
    for parameter in (*cause.shape, *cause.linear):
        assert -math.inf < parameter.lower < parameter.upper < math.inf
        assert parameter.unit
        assert parameter.description
    assert set(cause.channels) <= {"load_torque_nm", "motor_current_a", "temperature_c"}
    names = [parameter.name for parameter in cause.linear]
    assert cause.harmonic == (names == ["cosine_nm", "sine_nm"])


def test_an_unknown_cause_is_told_with_the_nearest_name():
    with pytest.raises(DataError, match="nearest is 'coulomb-friction'") as caught:
        model.cause_named("coulomb_frictoin", where="model.json: key causes.0.name")
    assert caught.value.where == "model.json: key causes.0.name"


def test_users_add_causes_but_cannot_replace_one():
    base = model.catalogue()["zero-drift"]
    own = replace(base, name="my-effect", columns=lambda motion, _: np.ones((len(motion), 1)))
    assert model.catalogue([own])["my-effect"] is own
    assert "my-effect" not in model.catalogue()
    with pytest.raises(DataError, match="two causes have the name"):
        model.catalogue([base])


@pytest.mark.parametrize(
    ("term", "words"),
    [
        (model.CauseTerm("mains-hum", {"frequency_hz": 55.0}, (0.1, 0.0)), "49.5 to 50.5 or 59.5"),
        (model.CauseTerm("mains-hum", {"frequency_hz": math.nan}, (0.1, 0.0)), "is nan Hz"),
        (model.CauseTerm("mains-hum", {}, (0.1, 0.0)), "shape parameters"),
        (model.CauseTerm("viscous-friction", {}, (0.1, 0.0)), "2 linear values"),
        (model.CauseTerm("viscous-friction", {}, (math.inf,)), "is inf N m s/rad"),
        (model.CauseTerm("viscous-friction", {"order": 1.0}, (0.1,)), "shape parameters"),
    ],
)
def test_numbers_that_do_not_fit_a_cause_are_refused(term, words):
    with pytest.raises(DataError, match=words):
        model.check_term(term, where="here")


def test_parameter_domains_hold_their_ends_and_no_nan():
    parameter = model.Parameter("x", "1", 0.0, 2.0, "test", bands=((0.0, 0.5), (1.5, 2.0)))
    values = (0.0, 0.5, 0.6, 1.5, 2.0, 2.1, math.nan)
    assert [parameter.contains(v) for v in values] == [True, True, False, True, True, False, False]


@given(amplitude=st.floats(1e-6, 1e3), phase=st.floats(-3.14, 3.14), x=st.floats(-10, 10))
def test_amplitude_and_phase_are_those_of_the_contract(amplitude, phase, x):
    cosine, sine = amplitude * math.cos(phase), -amplitude * math.sin(phase)
    a, p, _, _ = model.amplitude_phase(cosine, sine)
    # a few roundings of numbers of the size of the amplitude, times |x| of the argument
    want = pytest.approx(a * math.cos(x + p), rel=0, abs=1e-13 * amplitude)
    assert cosine * math.cos(x) + sine * math.sin(x) == want
    assert a == pytest.approx(amplitude, rel=1e-14, abs=0)


def test_uncertainties_of_amplitude_and_phase_agree_with_simulated_scatter():
    rng = np.random.default_rng(11)
    covariance = np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    draws = rng.multivariate_normal([0.6, -0.8], covariance, 40_000)
    table = model.cause_parameters(model.CauseTerm("misalignment", {}, (0.6, -0.8), covariance))
    amplitude = np.hypot(draws[:, 0], draws[:, 1])
    phase = np.arctan2(-draws[:, 1], draws[:, 0])
    # 40 000 draws know a standard deviation to 0.35 %; 2 % leaves the curvature of the formulas
    assert table["amplitude_nm"]["std"] == pytest.approx(amplitude.std(), rel=0.02, abs=0)
    assert table["phase_rad"]["std"] == pytest.approx(phase.std(), rel=0.02, abs=0)
    assert table["amplitude_nm"]["value"] == pytest.approx(1.0, rel=1e-15, abs=0)
    assert table["cosine_nm"] == {"value": 0.6, "std": 0.02, "unit": "N m"}


def test_parameters_of_several_pairs_and_of_shapes_are_all_there():
    term = model.CauseTerm("ripple-beat", {}, (3.0, 4.0, 0.0, 0.0))
    table = model.cause_parameters(term)
    assert table["amplitude_lower_nm"] == {"value": 5.0, "std": None, "unit": "N m"}
    assert table["amplitude_upper_nm"]["value"] == 0.0
    assert table["phase_upper_rad"]["std"] is None
    matrix = np.diag([1.0, 4.0, 9.0])
    term = model.CauseTerm("mains-hum", {"frequency_hz": 50.0}, (0.1, 0.0), matrix)
    assert model.cause_parameters(term)["frequency_hz"] == {"value": 50.0, "std": 3.0, "unit": "Hz"}
    alone = model.cause_parameters(replace(term, covariance=matrix[:2, :2]))
    assert alone["frequency_hz"]["std"] is None
    with pytest.raises(ValueError, match="covariance of mains-hum"):
        model.cause_parameters(replace(term, covariance=np.eye(4)))


def test_the_page_on_the_model_holds_every_equation():
    page = (Path(__file__).parents[2] / "docs" / "model.md").read_text(encoding="utf-8")
    rows = {f"| `{name}` | `{cause.equation}` |" for name, cause in model.catalogue().items()}
    assert {row for row in rows if row not in page} == set()
