"""A whole bench on the emulated T7: the session's side of it."""

import json

import numpy as np
import pytest
from served import sampled

from hdbench.devices import open_bench
from hdbench.devices.bench import AcquisitionSettings
from hdbench.devices.emulator.serving import EmulatorSettings, emulate
from hdbench.errors import UsageError
from hdbench.model import BenchModel, save_model
from hdbench.profile import load_profile
from hdbench.profile.schema import ReferenceWave

T7 = load_profile("labjack-t7")
NODE = load_profile("cim-tr-97-06")


def test_with_the_same_seed_the_t7_and_the_node_measure_the_same_bench():
    settings = AcquisitionSettings(0.01, 150, None)
    with open_bench(NODE, seed=9) as bench:
        node = sampled(bench, settings)
    with open_bench(T7, seed=9) as bench:
        t7 = sampled(bench, settings)
    # the same torque and the same noise, sample by sample: a step of each converter, 0.32 mV
    assert np.max(np.abs(t7.torque_v - node.torque_v)) < 3.3e-4
    assert np.max(np.abs(t7.tacho_v - node.tacho_v)) < 3.3e-4
    assert np.array_equal(t7.encoder_count, node.encoder_count)


@pytest.mark.usefixtures("patient_control")
def test_a_motion_runs_from_reference_to_standstill(tmp_path):
    record = tmp_path / "record.jsonl"
    wave = ReferenceWave(wave="sine", amplitude_v=1.0, frequency_hz=0.25)
    # in real time: a value that a busy machine writes late is not late five times over
    with open_bench(T7, seed=2, realtime=True, record=record) as bench:
        got = sampled(bench, AcquisitionSettings(1e-3, 2000, wave))
        assert bench.safe_state().confirmed
    assert got.lost == 0
    assert len(got.torque_v) == 2000
    # the reference as it was looped back: a staircase of host writes along the sine; on a busy
    # machine a value may come 0.2 s late, 0.3 V of the sine's slope
    due = np.sin(0.5 * np.pi * 1e-3 * np.arange(2000))
    assert np.median(np.abs(got.reference_v - due)) < 0.3
    speed = got.tacho_v * T7.data.tacho.gain_rad_s_per_v
    assert np.max(speed) == pytest.approx(56.3, rel=0.1)
    # encoder and tacho tell the same motion: counts against integrated volts
    turned = got.encoder_count * 2.0 * np.pi / T7.data.encoder.counts_per_turn
    assert np.max(np.abs(turned - turned[0] - np.cumsum(speed - speed[0]) * 1e-3)) < 0.5
    events = [json.loads(line) for line in record.read_text().splitlines()]
    assert {event["event"] for event in events} >= {"begin", "enable", "reference", "disable"}
    assert events[-1]["enabled"] is False
    assert abs(events[-1]["reference_v"]) == 0.0


def test_an_extended_model_is_refused_by_the_emulator(tmp_path):
    file = tmp_path / "model.json"
    save_model(file, BenchModel.from_profile(T7.data), profile=T7, provenance={})
    with pytest.raises(UsageError, match="written by its host"):
        emulate(
            T7.data, "as-modelled", 0, EmulatorSettings(), ready=lambda _: None, model_file=file
        )
