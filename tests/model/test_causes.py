from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdbench.errors import DataError
from hdbench.model import (
    Cause,
    CauseTerm,
    Motion,
    Parameter,
    amplitude_phase,
    catalogue,
    cause_named,
    cause_parameters,
    check_term,
    shape_bounds,
)

Make = Callable[..., Motion]
Shape = dict[str, float]

CONTRACT_LIST = """
ripple-harmonic wave-generator-eccentricity motor-unbalance load-dependent-ripple
torsional-resonance ripple-beat kinematic-error tooth-mesh bearing-defect gain-ripple
misalignment angular-misalignment load-gravity position-dependent-gain mains-hum
structural-tone coulomb-friction viscous-friction stribeck-friction load-dependent-friction
presliding gain-error cubic-nonlinearity hysteresis backlash saturation arm-sag side-force
direction-asymmetry inertia-error time-skew cubic-stiffness piecewise-stiffness zero-step
zero-drift warm-up creep zero-random-walk quantisation missed-samples encoder-slip tacho-ripple
spikes speed-dependent-noise crosstalk
"""
CONTRACT_NAMES = set(CONTRACT_LIST.split())


def wave(x: float, size: float = 1.0) -> list[float]:
    return [size * math.cos(x), size * math.sin(x)]


def bearing(angle: float, order: float) -> list[float]:
    return wave(order * angle) + wave(2 * order * angle) + wave(3 * order * angle)


# shape parameters to try, and the torque per unit of each linear parameter at one sample, in the
# plain numbers t, w, a (motor angle), o (output angle), alpha, load and g (gauge factor); the
# record starts at t0
BY_HAND: dict[str, tuple[Shape, Callable[..., list[float]]]] = {
    "ripple-harmonic": ({"order": 3.37}, lambda a, s, **_: wave(s["order"] * a)),
    "wave-generator-eccentricity": ({}, lambda a, **_: wave(a)),
    "motor-unbalance": ({}, lambda a, w, **_: wave(a, w * w / 1e4)),
    "load-dependent-ripple": ({}, lambda a, g, load, **_: wave(2 * g * a, abs(load) / 10)),
    "ripple-beat": ({}, lambda a, g, o, **_: wave(2 * g * a - o) + wave(2 * g * a + o)),
    "tooth-mesh": ({}, lambda a, **_: wave(202 * a)),
    "bearing-defect": ({"order": 4.95}, lambda a, s, **_: bearing(a, s["order"])),
    "misalignment": ({}, lambda o, **_: wave(o)),
    "angular-misalignment": ({}, lambda o, **_: wave(2 * o)),
    "load-gravity": ({}, lambda o, **_: wave(o)),
    "mains-hum": (
        {"frequency_hz": 49.98},
        lambda t, s, **_: wave(2 * math.pi * s["frequency_hz"] * t),
    ),
    "structural-tone": (
        {"frequency_hz": 37.0},
        lambda t, s, **_: wave(2 * math.pi * s["frequency_hz"] * t),
    ),
    "coulomb-friction": (
        {"transition_rad_s": 2.0},
        lambda w, s, **_: [1 - 2 / (math.exp(2 * w / s["transition_rad_s"]) + 1)],
    ),
    "viscous-friction": ({}, lambda w, **_: [w]),
    "stribeck-friction": (
        {"stribeck_rad_s": 15.0, "transition_rad_s": 1.5},
        lambda w, s, **_: [
            math.tanh(w / s["transition_rad_s"]) / math.exp((w / s["stribeck_rad_s"]) ** 2)
        ],
    ),
    "inertia-error": ({}, lambda alpha, **_: [alpha / 100]),
    "gain-error": ({}, lambda load, **_: [load]),
    "zero-step": ({"step_time_s": 3.2}, lambda t, s, **_: [float(t >= s["step_time_s"])]),
    "zero-drift": ({}, lambda t, t0, **_: [t - t0]),
    "warm-up": (
        {"time_constant_s": 7.0},
        lambda t, t0, s, **_: [1 - math.exp(-(t - t0) / s["time_constant_s"])],
    ),
}


def test_every_cause_is_checked_here_and_named_in_the_contract() -> None:
    assert set(BY_HAND) == set(catalogue())
    assert set(catalogue()) <= CONTRACT_NAMES


@pytest.mark.parametrize("gauge", [1.0, 1.01])
@pytest.mark.parametrize("name", BY_HAND)
def test_columns_follow_the_equation(name: str, gauge: float, make_motion: Make) -> None:
    motion = make_motion(gauge_factor=gauge)
    shape, formula = BY_HAND[name]
    got = catalogue()[name].columns(motion, shape)
    assert got.shape == (len(motion), len(catalogue()[name].linear))
    for k in range(0, len(motion), 7):
        want = formula(
            t=float(motion.time_s[k]),
            t0=float(motion.time_s[0]),
            w=float(motion.velocity_rad_s[k]),
            a=float(motion.angle_rad[k]),
            o=float(motion.output_angle_rad[k]),
            alpha=float(motion.acceleration_rad_s2[k]),
            load=float(motion.load_torque_nm[k]),
            g=gauge,
            s=shape,
        )
        # the angle of order 202 reaches 4e5 rad, where doubles are 6e-11 apart; products of three
        # factors may be rounded in another order
        np.testing.assert_allclose(got[k], want, rtol=1e-12, atol=2e-10)


@pytest.mark.parametrize("cause", catalogue().values(), ids=lambda cause: cause.name)
def test_a_record_of_the_catalogue_is_complete(cause: Cause) -> None:
    for text in (cause.equation, cause.parity, cause.experiment, cause.source):
        assert text.strip()
    assert cause.locked_to in {
        "motor", "output", "clock", "velocity", "acceleration", "load", "time"
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


def steady(make: Make, **replaced: Any) -> Motion:
    """Return 20 s at 60 rad/s: two output turns need 21 s, one is there."""
    time = np.arange(20_000) * 1e-3
    values: dict[str, Any] = {
        "time_s": time,
        "velocity_rad_s": np.full(20_000, 60.0),
        "angle_rad": 60.0 * time,
        "acceleration_rad_s2": np.zeros(20_000),
        "output_angle_rad": 0.6 * time,
        "angle_source": "velocity",
        "load_torque_nm": None,
    }
    return make(20_000, **{**values, **replaced})


def test_a_constant_speed_without_load_shows_what_it_can(make_motion: Make) -> None:
    motion = steady(make_motion)
    silent = {name for name, cause in catalogue().items() if cause.applicable(motion) is not None}
    assert silent == {
        "load-dependent-ripple",
        "tooth-mesh",
        "coulomb-friction",
        "viscous-friction",
        "stribeck-friction",
        "inertia-error",
        "gain-error",
    }


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("load-dependent-ripple", {}, "no load_torque_nm"),
        ("gain-error", {"load_torque_nm": np.zeros(20_000)}, "zero throughout"),
        ("tooth-mesh", {}, "motor_angle_rad or encoder_count"),
        ("coulomb-friction", {}, "keeps one direction"),
        ("viscous-friction", {}, "more than 5 %"),
        ("inertia-error", {}, "changes faster"),
        ("ripple-harmonic", {"angle_rad": np.linspace(0, 6, 20_000)}, "0.955 turns"),
        ("misalignment", {"output_angle_rad": np.linspace(0, 6, 20_000)}, "output covers 0.955"),
        ("mains-hum", {"time_s": np.arange(20_000) * 0.0125}, "80 samples/s"),
        ("structural-tone", {"time_s": np.arange(20_000) * 1e-5}, "0.2 s"),
        ("warm-up", {"time_s": np.arange(20_000) * 1e-5}, "0.2 s"),
        (
            "stribeck-friction",
            {"velocity_rad_s": np.repeat([100.0, -100.0], 10_000)},
            "0 samples move slower",
        ),
    ],
)
def test_a_record_that_cannot_show_a_cause_says_why(
    name: str, change: dict[str, Any], words: str, make_motion: Make
) -> None:
    reason = catalogue()[name].applicable(steady(make_motion, **change))
    assert reason is not None
    assert words in reason


def test_a_record_with_everything_shows_every_cause(make_motion: Make) -> None:
    time = np.arange(30_000) * 1e-3
    motion = make_motion(30_000, time_s=time, velocity_rad_s=60.0 * np.sin(time))
    assert [name for name, c in catalogue().items() if c.applicable(motion) is not None] == []


def test_lost_samples_do_not_count_for_what_a_record_shows(make_motion: Make) -> None:
    velocity = np.full(20_000, 60.0)
    velocity[7] = -60.0
    valid = np.arange(20_000) != 7
    friction = catalogue()["coulomb-friction"]
    assert friction.applicable(steady(make_motion, velocity_rad_s=velocity)) is None
    assert friction.applicable(steady(make_motion, velocity_rad_s=velocity, valid=valid))


def test_shapes_are_searched_where_the_record_can_show_them(make_motion: Make) -> None:
    motion = steady(make_motion, time_s=100.0 + np.arange(20_000) * 0.009)
    bands = {n: shape_bounds(c, motion) for n, c in catalogue().items()}
    # 9 ms period: half the sampling rate is 55.6 Hz, which leaves only the European mains
    assert bands["mains-hum"] == {"frequency_hz": ((49.5, 50.5),)}
    low, high = bands["structural-tone"]["frequency_hz"][0]
    assert low == 0.5
    # the period is a difference of times near 280 s: 1e-16 * 280 / 0.009
    assert high == pytest.approx(1 / 0.018, rel=1e-11, abs=0)
    assert bands["zero-step"] == {"step_time_s": ((100.0, float(motion.time_s[-1])),)}
    assert bands["ripple-harmonic"] == {"order": ((0.1, 60.0),)}


def test_an_unknown_cause_is_told_with_the_nearest_name() -> None:
    with pytest.raises(DataError, match="nearest is 'coulomb-friction'") as caught:
        cause_named("coulomb_frictoin", where="model.json: key causes.0.name")
    assert caught.value.where == "model.json: key causes.0.name"


def test_users_add_causes_but_cannot_replace_one() -> None:
    def columns(motion: Motion, shape: Any) -> np.ndarray:
        return np.ones((len(motion), 1))

    base = catalogue()["zero-drift"]
    parts = {f: getattr(base, f) for f in base.__slots__}
    own = Cause(**{**parts, "name": "my-effect", "columns": columns})
    assert catalogue([own])["my-effect"] is own
    assert "my-effect" not in catalogue()
    with pytest.raises(DataError, match="two causes have the name"):
        catalogue([base])


@pytest.mark.parametrize(
    ("term", "words"),
    [
        (CauseTerm("mains-hum", {"frequency_hz": 55.0}, (0.1, 0.0)), "49.5 to 50.5 or 59.5"),
        (CauseTerm("mains-hum", {"frequency_hz": math.nan}, (0.1, 0.0)), "is nan Hz"),
        (CauseTerm("mains-hum", {}, (0.1, 0.0)), "shape parameters"),
        (CauseTerm("viscous-friction", {}, (0.1, 0.0)), "2 linear values"),
        (CauseTerm("viscous-friction", {}, (math.inf,)), "is inf N m s/rad"),
        (CauseTerm("viscous-friction", {"order": 1.0}, (0.1,)), "shape parameters"),
    ],
)
def test_numbers_that_do_not_fit_a_cause_are_refused(term: CauseTerm, words: str) -> None:
    with pytest.raises(DataError, match=words):
        check_term(term, where="here")


def test_parameter_domains_hold_their_ends_and_no_nan() -> None:
    parameter = Parameter("x", "1", 0.0, 2.0, "test", bands=((0.0, 0.5), (1.5, 2.0)))
    values = (0.0, 0.5, 0.6, 1.5, 2.0, 2.1, math.nan)
    assert [parameter.contains(v) for v in values] == [True, True, False, True, True, False, False]


@settings(deadline=None)
@given(amplitude=st.floats(1e-6, 1e3), phase=st.floats(-3.14, 3.14), x=st.floats(-10, 10))
def test_amplitude_and_phase_are_those_of_the_contract(
    amplitude: float, phase: float, x: float
) -> None:
    cosine, sine = amplitude * math.cos(phase), -amplitude * math.sin(phase)
    a, p, _, _ = amplitude_phase(cosine, sine)
    # a few roundings of numbers of the size of the amplitude, times |x| of the argument
    want = pytest.approx(a * math.cos(x + p), rel=0, abs=1e-13 * amplitude)
    assert cosine * math.cos(x) + sine * math.sin(x) == want
    assert a == pytest.approx(amplitude, rel=1e-14, abs=0)


def test_uncertainties_of_amplitude_and_phase_agree_with_simulated_scatter() -> None:
    rng = np.random.default_rng(11)
    covariance = np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    draws = rng.multivariate_normal([0.6, -0.8], covariance, 40_000)
    term = CauseTerm("misalignment", {}, (0.6, -0.8))
    table = cause_parameters(term, covariance)
    amplitude = np.hypot(draws[:, 0], draws[:, 1])
    phase = np.arctan2(-draws[:, 1], draws[:, 0])
    # 40 000 draws know a standard deviation to 0.35 %; 2 % leaves the curvature of the formulas
    assert table["amplitude_nm"]["std"] == pytest.approx(amplitude.std(), rel=0.02, abs=0)
    assert table["phase_rad"]["std"] == pytest.approx(phase.std(), rel=0.02, abs=0)
    assert table["amplitude_nm"]["value"] == pytest.approx(1.0, rel=1e-15, abs=0)
    assert table["cosine_nm"] == {"value": 0.6, "std": 0.02, "unit": "N m"}


def test_parameters_of_several_pairs_and_of_shapes_are_all_there() -> None:
    term = CauseTerm("ripple-beat", {}, (3.0, 4.0, 0.0, 0.0))
    table = cause_parameters(term)
    assert table["amplitude_lower_nm"] == {"value": 5.0, "std": None, "unit": "N m"}
    assert table["amplitude_upper_nm"]["value"] == 0.0
    assert table["phase_upper_rad"]["std"] is None
    matrix = np.diag([1.0, 4.0, 9.0])
    hum = cause_parameters(CauseTerm("mains-hum", {"frequency_hz": 50.0}, (0.1, 0.0)), matrix)
    assert hum["frequency_hz"] == {"value": 50.0, "std": 3.0, "unit": "Hz"}
    alone = cause_parameters(
        CauseTerm("mains-hum", {"frequency_hz": 50.0}, (0.1, 0.0)), matrix[:2, :2]
    )
    assert alone["frequency_hz"]["std"] is None
    with pytest.raises(ValueError, match="covariance of mains-hum"):
        cause_parameters(CauseTerm("mains-hum", {"frequency_hz": 50.0}, (0.1, 0.0)), np.eye(4))


def test_the_page_on_the_model_holds_every_equation() -> None:
    page = (Path(__file__).parents[2] / "docs" / "model.md").read_text(encoding="utf-8")
    rows = {f"| `{name}` | `{cause.equation}` |" for name, cause in catalogue().items()}
    assert {row for row in rows if row not in page} == set()
