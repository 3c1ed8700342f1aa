"""Looking on moves nothing, keeps nothing, and tells what the channels did."""

import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from changing import with_keys
from fakes import WHOLE
from faults.lines import behind, emulated
from faults.mangler import Mangler, TcpFraming
from plant_tools import AS_MODELLED

from hdbench.devices.emulator.node import build_core
from hdbench.filter import preset
from hdbench.plant.bench import SimulatedBench
from hdbench.profile.scaling import profile_scale
from hdbench.session.monitor import ChannelStatistics, Observation, observe
from hdbench.session.recorder import Frame
from hdbench.session.stop import StopSignals


class Seen:
    """Keeps the frames, and acts at each."""

    def __init__(self, act: Callable[[], object] = lambda: None) -> None:
        self.act = act
        self.frames: list[Frame] = []

    def frame(self, frame: Frame) -> None:
        self.act()
        self.frames.append(frame)

    def asking(self, *, now: bool) -> None:
        raise AssertionError(now)


def look(
    watcher: object, duration_s: float | None = None, stop=None, profile=WHOLE, **named
) -> Observation:
    scale, model = profile_scale(profile), preset("report-6", profile.data)
    told = {"address": None, "plant": "as-modelled", "seed": 0, **named}
    stop = stop or StopSignals()
    return observe(profile, scale, model, watcher, stop, duration_s=duration_s, **told)


def test_statistics_by_blocks_are_those_of_all_samples():
    rng = np.random.default_rng(3)
    # far from zero, where a sum of squares would lose eight digits
    values = 1e6 + rng.standard_normal(10_000)
    values[17] = np.nan
    found = ChannelStatistics("V")
    for part in np.array_split(values, 37):
        found.add(part)
    told = found.to_dict()
    assert told["n"] == 9_999
    assert told["mean"] == pytest.approx(np.nanmean(values), rel=1e-14)
    assert told["std"] == pytest.approx(np.nanstd(values, ddof=1), rel=1e-9)
    assert (told["min"], told["max"]) == (np.nanmin(values), np.nanmax(values))


def test_a_channel_without_a_sample_has_no_numbers():
    found = ChannelStatistics("V")
    found.add(np.full(5, np.nan))
    none = dict.fromkeys(("mean", "std", "min", "max"))
    assert found.to_dict() == {"unit": "V", "n": 0, **none}


def test_the_drive_stays_disabled_and_no_run_is_left(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    seen = Seen()
    found = look(seen, 0.3, plant="worn", seed=1)
    assert found.samples == 300
    assert found.safe_state.confirmed
    assert found.stopped_by is None
    told = found.channels
    assert told["reference_v"]["max"] == 0.0
    # one count of the encoder: nothing turned
    turn = 2.0 * np.pi / WHOLE.data.encoder.counts_per_turn
    assert told["motor_angle_rad"]["max"] - told["motor_angle_rad"]["min"] <= turn
    assert sum(len(f.columns["time_s"]) for f in seen.frames) == 300
    assert list(tmp_path.iterdir()) == []


def test_a_bench_without_an_encoder_is_watched_by_what_it_has():
    bare = replace(WHOLE, data=with_keys(WHOLE.data, daq={"channels": ("torque", "tacho")}))
    told = look(Seen(), 0.1, profile=bare).channels
    assert told["torque_nm"]["n"] == 100
    assert told["motor_angle_rad"]["n"] == 0


def test_a_signal_ends_it_with_the_bench_safe():
    stop = StopSignals()
    found = look(Seen(lambda: stop.note(signal.SIGINT, None)), stop=stop)
    assert found.stopped_by == signal.SIGINT
    assert found.safe_state.confirmed
    assert found.samples < 2000


def test_what_looks_on_is_told_how_often_the_driver_asked_again():
    """One reply in twenty is lost; the count comes from the driver, through block and frame."""
    spoiler = Mangler("drop", TcpFraming(), share=0.0, seed=1)
    seen = Seen(partial(setattr, spoiler, "share", 0.05))
    core = build_core(SimulatedBench(WHOLE.data, AS_MODELLED, 0), WHOLE.data, 0, pace="fast")
    # two replies in a row may be lost, or come late on a busy machine
    patient = with_keys(WHOLE.data, daq={"deadline_s": 1.0, "watchdog_s": 2.0})
    patient = replace(WHOLE, data=patient)
    with emulated(core) as node, behind(node, spoiler) as address:
        found = look(seen, 1.5, profile=patient, address=address, plant="")
    assert found.samples == 1500
    retries = [frame.retries for frame in seen.frames]
    assert retries == sorted(retries)
    assert retries[0] == 0
    # a lost reply is the only fault there is; a busy machine may add late ones
    assert retries[-1] >= 1
