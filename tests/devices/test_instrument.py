"""The simulated bench at its terminals, and its agreement with the emulated node."""

import numpy as np
import pytest
from plant_tools import AS_MODELLED, WORN, profile, quiet_profile

from hdbench.devices.emulator.instrument import SimulatedInstrument, device_clock
from hdbench.errors import UsageError
from hdbench.plant.bench import SimulatedBench
from hdbench.profile.schema import ReferenceWave

PERIOD_S = 1e-3
COUNTS = profile().encoder.counts_per_turn


CHANNELS = ("torque", "tacho", "current", "reference")


class Bench:
    """An instrument with a clock that goes when told; it samples where `samples`."""

    def __init__(
        self, *, seed=3, plant=AS_MODELLED, data=None, enabled=False, samples=False
    ) -> None:
        self.now_s = 50.0
        self.events: list[dict[str, object]] = []
        self.instrument = SimulatedInstrument(
            SimulatedBench(data or profile(), plant, seed),
            COUNTS,
            clock=lambda: self.now_s,
            record=lambda event: self.events.append(dict(event)),
        )
        if enabled:
            self.instrument.write_enable(on=True)
        if samples:
            self.instrument.begin(PERIOD_S)

    def run(self, seconds: float, volts=None, *, step_s: float = 0.005) -> dict[str, np.ndarray]:
        """Let time pass, writing ``volts(t)`` at every step; return what was sampled."""
        taken = []
        for k in range(round(seconds / step_s)):
            if volts is not None:
                self.instrument.write_reference(volts(k * step_s))
            # a hair more, so that rounding does not keep a sample back
            self.now_s += step_s + 1e-9
            taken.append(self.instrument.take(10**6))
        channels = {
            name: np.concatenate([samples.volts[name] for samples in taken]) for name in CHANNELS
        }
        return {**channels, "count": np.concatenate([samples.count for samples in taken])}

    def idle(self, seconds: float) -> None:
        """Let time pass while nobody samples."""
        for _ in range(round(seconds / 0.005)):
            self.now_s += 0.005
            self.instrument.catch_up()

    def torque_v(self, after_s: float) -> float:
        """Return a reading of the torque after a time."""
        self.now_s += after_s
        return self.instrument.look().volts["torque"][-1]

    def hang(self, mass_kg: float) -> None:
        self.instrument.present().set_fixture(
            locked=True, position_rad=0.0, mass_kg=mass_kg, direction=1
        )


def test_a_host_that_writes_what_the_node_generates_gets_the_nodes_samples():
    wave = ReferenceWave(wave="sine", amplitude_v=1.5, frequency_hz=0.5)
    node = SimulatedBench(profile(), WORN, 7)
    node.begin(sample_period_s=PERIOD_S, wave=wave, duration_s=1.0)
    true = node.measure(800)
    bench = Bench(seed=7, plant=WORN, enabled=True, samples=True)
    got = bench.run(0.9, lambda t: 1.5 * np.sin(np.pi * t), step_s=PERIOD_S)
    # same bench, same noise, the same reference in every hold: the same bits but for rounding
    for name in CHANNELS:
        assert np.max(np.abs(got[name][:800] - getattr(true, f"{name}_v"))) < 1e-9, name
    turns = true.angle_rad * COUNTS / (2.0 * np.pi)
    assert np.array_equal(got["count"][:800], np.floor(turns + 0.5))


def test_samples_come_by_the_clock_and_any_split_gives_the_same():
    whole, split = Bench(samples=True), Bench(samples=True)
    whole.now_s += 0.2 + 1e-9
    first = whole.instrument.take(1000)
    # a filter of eight periods to either side: the newest sample is seven periods old
    assert len(first) == 193
    pieces = []
    for _ in range(40):
        split.now_s += 0.005
        pieces.append(split.instrument.take(1000))
    assert [piece.first_index for piece in pieces if len(piece)][:2] == [0, 3]
    torque = np.concatenate([piece.volts["torque"] for piece in pieces])
    assert np.allclose(torque[:192], first.volts["torque"][:192], rtol=0.0, atol=1e-9)


def test_a_written_value_acts_from_the_next_hold_and_moves_only_an_enabled_drive():
    bench = Bench(data=quiet_profile(), samples=True)
    bench.now_s += 0.05
    bench.instrument.write_reference(2.0)
    got = bench.run(0.1)
    assert np.flatnonzero(got["reference"])[0] in (50, 51)
    assert np.all(got["tacho"] == 0.0), "the line is off"
    bench.instrument.write_enable(on=True)
    assert np.max(bench.run(0.3)["tacho"]) == pytest.approx(2.0, abs=0.01)
    bench.instrument.write_enable(on=False)
    braked = bench.run(0.5)
    assert abs(braked["tacho"][-1]) < 1e-3
    assert braked["reference"][-1] == 2.0, "the terminal still has its volts"
    assert not bench.instrument.moving


def test_a_motor_goes_on_between_acquisitions_and_the_counter_never_jumps():
    bench = Bench(data=quiet_profile(), enabled=True, samples=True)
    before = bench.run(0.5, lambda _: 1.0)
    bench.instrument.end()
    assert bench.instrument.moving
    bench.idle(0.1)
    bench.instrument.begin(2e-3)
    after = bench.run(0.1)
    assert after["tacho"][0] == pytest.approx(1.0, abs=1e-6)
    # 56.3 rad/s for the 0.1 s between, 0.0157 s of filter included: counts per second
    rate = 56.2565 * COUNTS / (2.0 * np.pi)
    assert after["count"][0] - before["count"][-1] == pytest.approx(0.108 * rate, rel=0.1)
    assert np.all(np.diff(after["count"]) == pytest.approx(rate * 2e-3, abs=1.0))


def test_a_bench_that_stands_begins_at_its_home_marks_and_the_counter_says_so():
    bench = Bench(data=quiet_profile(), enabled=True, samples=True)
    bench.run(0.5, lambda _: 1.0)
    assert bench.run(0.6, lambda _: 0.0)["count"][-1] > 10_000
    bench.instrument.end()
    bench.instrument.begin(PERIOD_S)
    second = bench.run(0.1)
    assert np.all(second["count"] == 0)
    # at the home mark again: the ripple is that of angle 0
    home = Bench(data=quiet_profile(), samples=True)
    assert second["torque"][0] == pytest.approx(home.run(0.1)["torque"][0], abs=1e-12)


def test_idle_time_costs_nothing_while_the_motor_stands_and_stops_one_that_turns():
    bench = Bench(data=quiet_profile())
    bench.now_s += 8 * 3600.0
    assert len(bench.instrument.look()) <= 1000
    bench.instrument.write_enable(on=True)
    bench.instrument.write_reference(1.0)
    bench.idle(0.3)
    assert bench.instrument.velocity_rad_s == pytest.approx(56.2565, rel=1e-3)
    bench.instrument.write_reference(0.0)
    bench.idle(0.5)
    assert not bench.instrument.moving
    assert bench.events[-1]["velocity_rad_s"] == pytest.approx(0.0, abs=1e-3)


def test_a_polled_reading_follows_the_clock():
    bench = Bench()
    readings = [bench.torque_v(0.01) for _ in range(50)]
    assert len(set(readings)) == 50, "each has noise of its own"
    assert bench.torque_v(0.0) == readings[-1], "asked at the same moment, the same reading"


def test_static_loads_settle_while_they_are_read():
    bench = Bench(data=quiet_profile())
    bench.hang(0.0)
    zero = bench.torque_v(0.5)
    bench.hang(4.0)
    readings = [bench.torque_v(0.05) - zero for _ in range(200)]
    # 4 kg on 0.5 m at 9.8065 m/s2, 6.6 N m/V, gain spread 2 %
    assert np.mean(readings[-20:]) == pytest.approx(4.0 * 9.8065 * 0.5 / 6.6, rel=0.1)
    assert np.ptp(readings[-20:]) < 0.01
    assert np.ptp(readings[:20]) > 0.05, "it bounces when it is hung"


def test_hours_of_writing_take_no_memory():
    bench = Bench(data=quiet_profile(), enabled=True, samples=True)
    bench.run(3.0, np.sin)
    # what was written before the newest sample is over
    assert len(bench.instrument._put_out._written) < 10
    assert len(bench.instrument._timeline._reference._written) < 10


def test_device_time_runs_at_its_speed():
    clock = device_clock(8.0, clock=iter((10.0, 12.5)).__next__)
    assert clock() == 20.0


def test_an_extended_model_is_refused_where_the_motion_is_not_known_beforehand():
    bench = SimulatedBench(profile(), AS_MODELLED, 1)
    bench._causes.model = object()
    with pytest.raises(UsageError, match="whole motion beforehand"):
        bench.begin_host_written(sample_period_s=1e-3)
