"""Weights that swing, come off, or are wrong; a shunt; the operator's mistakes."""

import math

import numpy as np
import pytest
from plant_tools import AS_MODELLED, quiet_profile

from hdbench.devices.operator import Mistake, Mistakes, SimulatedOperator, parse_mistakes
from hdbench.errors import UsageError
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.fixture import FREE_SWING_S, ArmLoad, shunt_volts
from hdbench.plant.plantfile import FixtureSpec
from hdbench.profile.calibrating import ShuntCheck

V_PER_CODE = 10.0 / 32768.0
STILL = FixtureSpec(swing_rad=0.0)


def reading_v(bench: SimulatedBench, seconds: float = 6.0) -> np.ndarray:
    bench.begin(sample_period_s=0.01, wave=None, duration_s=seconds)
    return bench.advance(round(100 * seconds)).torque_code * V_PER_CODE


def hang(bench: SimulatedBench, mass: float) -> None:
    bench.set_fixture(locked=True, position_rad=0.0, mass_kg=mass, direction=1)


def empty_bench() -> SimulatedBench:
    bench = SimulatedBench(quiet_profile(), AS_MODELLED, 7)
    hang(bench, 0.0)
    return bench


def swinging_bench() -> SimulatedBench:
    """Return a bench on which 4 kg were let go at 0.2 rad."""
    bench = empty_bench()
    bench.set_handling(swing_rad=0.2, release_s=0.0, shunt_ohm=0.0)
    hang(bench, 4.0)
    return bench


def test_a_free_weight_swings_at_twice_the_pendulum_s_frequency_and_goes_on() -> None:
    bench = swinging_bench()
    late = reading_v(bench)[300:]
    # 4 kg on 0.5 m: 2.97 V; the force varies by angle squared, 4 %, after 3 s of 60 s decay
    expected = 2.97 * 0.2**2 * math.exp(-2 * 4.5 / FREE_SWING_S)
    assert np.ptp(late) / 2 == pytest.approx(expected, rel=0.1)
    spectrum = np.abs(np.fft.rfft((late - late.mean()) * np.hanning(300), 4096))
    frequency = np.argmax(spectrum) / 4096 / 0.01
    assert frequency == pytest.approx(math.sqrt(9.8065 / 0.3) / math.pi, rel=0.02)


def test_handling_holds_for_one_weight_only() -> None:
    bench = swinging_bench()
    reading_v(bench)
    hang(bench, 2.0)
    # the plant's own swing of 0.035 rad is steadied within a second or so: 1.8 mV after 3 s
    assert np.ptp(reading_v(bench)[300:]) < 2e-3


def test_a_weight_that_is_let_go_early_comes_off_and_can_be_hung_again() -> None:
    bench = empty_bench()
    zero = reading_v(bench)[-100:].mean()
    bench.set_handling(swing_rad=0.0, release_s=0.7, shunt_ohm=0.0)
    hang(bench, 4.0)
    found = reading_v(bench) - zero
    assert found[40:65].mean() > 2.5
    assert abs(found[-100:].mean()) < 2e-3
    hang(bench, 4.0)
    assert reading_v(bench)[-100:].mean() - zero == pytest.approx(2.97, rel=0.1)


def test_a_released_weight_is_continuous_and_ends_at_nothing() -> None:
    load = ArmLoad(0.0, 10.0, 9.8065, STILL, release_s=0.7)
    age = np.linspace(0.0, 6.0, 60_001)
    torque = load.torque_nm(age)
    # steps of 0.1 ms of a bounce of 12 Hz and at most 20 N m: 2 pi 12 * 20 * 1e-4
    assert np.abs(np.diff(torque)).max() < 0.16
    assert abs(torque[-1]) < 1e-6


def test_a_shunt_adds_what_four_equal_arms_give() -> None:
    # Wheatstone by hand: 350 || 200k against 350 in one divider, 350 and 350 in the other
    parallel = 350.0 * 200e3 / (350.0 + 200e3)
    by_hand = 10.0 * (0.5 - parallel / (350.0 + parallel)) * 1000.0
    profile = quiet_profile(calibration={"shunt": ShuntCheck(resistor_ohm=200e3)})
    assert shunt_volts(profile, 200e3) == pytest.approx(by_hand, rel=1e-9)
    assert shunt_volts(profile, 0.0) == 0.0
    bench = SimulatedBench(profile, AS_MODELLED, 7)
    hang(bench, 0.0)
    before = reading_v(bench)[-100:].mean()
    bench.set_handling(swing_rad=0.0, release_s=0.0, shunt_ohm=200e3)
    # half a code of the converter on either
    assert reading_v(bench)[-100:].mean() - before == pytest.approx(by_hand, abs=V_PER_CODE)


@pytest.mark.parametrize(
    ("text", "planned"),
    [
        ("", ()),
        ("wrong-weight@5", (Mistake("wrong-weight", 5),)),
        (
            "wrong-weight@5:0.5, swing@7,early-release@9:1.5",
            (
                Mistake("wrong-weight", 5, 0.5),
                Mistake("swing", 7),
                Mistake("early-release", 9, 1.5),
            ),
        ),
    ],
)
def test_a_list_of_mistakes_is_read(text: str, planned: tuple[Mistake, ...]) -> None:
    assert parse_mistakes(text) == planned


@pytest.mark.parametrize("text", ["swing", "swing@0", "swing@-1", "swing@1e3", "drop@4", "@4"])
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is no mistake"):
        parse_mistakes(text)


def test_a_mistake_is_made_once_and_chosen_by_the_seed() -> None:
    planned = parse_mistakes("wrong-weight@5,swing@5,early-release@6")
    mistakes = Mistakes(planned, (0.0, 0.5, 1.0, 2.0), seed=3)
    assert set(mistakes.of(5, 1)) == {"wrong-weight", "swing"}
    assert 0.1 <= mistakes.of(5, 1)["swing"] <= 0.25
    assert mistakes.of(5, 2) == {}
    assert mistakes.of(4, 1) == {}
    assert mistakes.of(6, 1) == {"early-release": 0.7}
    chosen = {Mistakes(planned, (0.0, 0.5, 1.0, 2.0), s).other_mass_kg(1.0, 5) for s in range(40)}
    # each of three with probability 1/3: one is missed by 40 seeds with probability 3e-7
    assert chosen == {0.0, 0.5, 2.0}
    assert mistakes.other_mass_kg(1.0, 5) == mistakes.other_mass_kg(1.0, 5)
    assert Mistakes().other_mass_kg(0.0, 1) == 1.0


class Bench:
    """A simulated bench that logs what is set."""

    def __init__(self) -> None:
        self.log: list[tuple[float, ...]] = []
        self.handled: list[tuple[float, ...]] = []
        self.simulation = self

    def set(self, *, fixture=None, handling=None) -> None:
        if fixture is not None:
            assert list(fixture) == ["locked", "position_rad", "mass_kg", "direction"]
            self.log.append(tuple(fixture.values()))
        if handling is not None:
            assert list(handling) == ["swing_rad", "release_s", "shunt_ohm"]
            self.handled.append(tuple(handling.values()))


def test_the_operator_hangs_the_wrong_weight_once() -> None:
    bench = Bench()
    operator = SimulatedOperator(bench, Mistakes(parse_mistakes("wrong-weight@4:1.5")))
    operator.mount(locked=True, position_rad=0.5)
    for attempt in (1, 2):
        operator.put(2.0, direction="ccw", number=4, attempt=attempt)
    assert bench.log == [(1.0, 0.5, 0.0, 1), (1.0, 0.5, 1.5, -1), (1.0, 0.5, 2.0, -1)]


def test_the_operator_sets_what_the_prompts_of_a_motion_run_ask() -> None:
    bench = Bench()
    operator = SimulatedOperator(bench)
    assert operator.confirm_lock(locked=True)
    assert operator.set_position(1.25, index=0, count=4)
    assert operator.hang(2.5, direction="ccw", expected_nm=-12.0, step="up 2")
    assert bench.log[-1] == (1.0, 1.25, 2.5, -1)
    assert operator.set_position(2.5, index=1, count=4)
    assert bench.log[-1] == (1.0, 2.5, 0.0, 1)
    assert operator.confirm_motion("turn")
    assert not SimulatedOperator(bench, motion=lambda _: False).confirm_motion("turn")


def test_the_operator_swings_drops_and_shunts() -> None:
    bench = Bench()
    operator = SimulatedOperator(bench, Mistakes(parse_mistakes("swing@4")), shunt_ohm=1e5)
    operator.put(2.0, direction="cw", number=4, attempt=1)
    assert bench.handled[-1][0] > 0.0
    assert operator.shunt(closed=True)
    assert bench.handled[-1] == (0.0, 0.0, 1e5)
    assert SimulatedOperator(bench).shunt(closed=True) is False


def test_a_fresh_bench_goes_through_the_history_and_a_kept_one_gets_the_last_state() -> None:
    first = SimulatedOperator(Bench())
    first.mount(locked=True, position_rad=0.5)
    first.put(2.0, direction="ccw", number=4, attempt=1)
    for fresh, expected in ((True, 2), (False, 1)):
        bench = Bench()
        again = SimulatedOperator(bench, fresh=fresh)
        again.restore(first.history(), 0)
        assert len(bench.log) == expected
        assert bench.log[-1] == (1.0, 0.5, 2.0, -1)
        assert again.history() == first.history()
