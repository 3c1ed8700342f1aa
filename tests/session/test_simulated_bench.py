"""Only the bench that this process started is simulated; a device's own word moves no motor."""

import csv
import json
import socket
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from changing import with_keys
from fakes import FakeOperator, quiet
from served import begin

from hdbench.devices import AcquisitionSettings, open_bench, opening
from hdbench.devices.emulator.process import running_emulator
from hdbench.errors import DeviceError, UsageError
from hdbench.plant.fixture import shunt_volts
from hdbench.profile import load_profile
from hdbench.profile.calibrating import ShuntCheck
from hdbench.profile.schema import ReferenceWave
from hdbench.session import BenchOptions, run_experiment
from hdbench.session.calibrating.conversation import Unattended
from hdbench.session.stop import Aborted

WAVE = ReferenceWave(
    wave="trapezoid", amplitude_v=2.773, frequency_hz=0.25, duty=0.8, rise=0.1, fall=0.1
)
SHUNT = ShuntCheck(resistor_ohm=100_000.0)
NAMES = ["cim-tr-97-06", "labjack-t7", "di-2108-ek9000", "seneca-z-sg"]


def emulator(name: str = NAMES[0], record: Path | None = None):
    data = load_profile(name).data
    return running_emulator(data, plant="as-modelled", seed=0, pace="fast", record=record)


def quick(name: str, found):
    profile = load_profile(name)
    data = opening._at(profile.data, found)
    calibration = {"positions": 1, "directions": ("cw",), "average_s": 0.5}
    calibration |= {"ranges": ("full",), "full_masses_kg": (0.0, 8.0)}
    calibration |= {"shunt": SHUNT}
    ripple = {"duration_s": 4.0, "reference": WAVE}
    return replace(profile, data=with_keys(data, calibration=calibration, ripple=ripple))


def moved(record: Path) -> bool:
    events = [json.loads(line) for line in record.read_text().splitlines()]
    return any(event.get("reference_v") for event in events)


@pytest.mark.parametrize("kind", ["ripple", "calibration"])
def test_a_device_that_calls_itself_simulated_is_taken_for_a_real_one(kind, tmp_path):
    record = tmp_path / "motor.jsonl"
    with emulator(record=record) as found:
        profile = quick(NAMES[0], found)
        with pytest.raises(UsageError, match="taken for a real bench") as caught:
            run_experiment(kind, profile, BenchOptions(tmp_path), quiet)
        with open_bench(profile) as bench:
            assert bench.identity().simulated, "it says so"
            assert bench.simulation is None
    assert "--yes" in caught.value.fix
    assert "--control" in caught.value.fix
    assert not moved(record)


def test_the_motion_of_a_bench_with_a_control_channel_is_asked_for(tmp_path):
    record = tmp_path / "motor.jsonl"
    with emulator(record=record) as found:
        profile = quick(NAMES[0], found)
        options = BenchOptions(tmp_path, control=str(found["control"]))
        with pytest.raises(UsageError, match="taken for a real bench"):
            run_experiment("ripple", profile, options, quiet)
        no = FakeOperator(None, refuse="motion")
        with pytest.raises(Aborted, match="not confirmed"):
            run_experiment("ripple", profile, replace(options, operator=no), quiet)
        assert no.asked == ["motion"], "the lock is the simulated operator's"
        assert not moved(record)
        yes = FakeOperator(None)
        assert run_experiment("ripple", profile, replace(options, operator=yes), quiet).folder
        assert yes.asked == ["motion"]
    assert moved(record)


@pytest.mark.parametrize("name", NAMES)
def test_a_simulated_operator_calibrates_every_emulator_by_its_channel(name, tmp_path):
    with emulator(name) as found:
        profile = quick(name, found)
        talk = Unattended(lambda _: None)
        options = BenchOptions(tmp_path, control=str(found["control"]), talk=talk)
        run = run_experiment("calibration", profile, options, quiet)
    gain = run.result.to_json()["gain_nm_per_v"]["value"]
    # the plant as modelled has the profile's gain, each clamping its own by some per mille
    assert gain == pytest.approx(profile.data.sensor.gain_nm_per_v, rel=0.03)
    rows = csv.DictReader((run.folder.path / "sequence.csv").read_text().splitlines())
    _, rest, shunt, *_ = (row["reading_v"] for row in rows)
    expected_v = shunt_volts(profile.data, SHUNT.resistor_ohm)
    assert float(shunt) - float(rest) == pytest.approx(expected_v, rel=0.01)


NO_HAND = [{"position_rad": float("nan")}, {"mass_kg": -1.0}, {"direction": 2}, {"locked": 7}]
NO_ORDER = [b"\n", b"{\n", b"[1]\n", b'{"fixture": {}}\n', b'{"x": 1}\n', b"[" * 60000 + b"\n"]
NO_CHANNEL = [b"", b"hello\r\n", b"[1]\n", b"1" * 5000 + b"\n", b"[" * 4000 + b"\n"]


def test_the_channel_refuses_what_no_hand_can_do_and_whoever_reaches_into_a_node_that_samples():
    right = {"locked": True, "position_rad": 0.0, "mass_kg": 1.0, "direction": 1}
    with open_bench(load_profile("cim-tr-97-06"), realtime=True) as bench:
        for wrong in NO_HAND:
            with pytest.raises(DeviceError, match="out of its domain"):
                bench.simulation.set(fixture={**right, **wrong})
            bench.simulation.set(fixture=right)
        begin(bench, AcquisitionSettings(1e-3, 100_000, None))
        with pytest.raises(DeviceError, match="acquisition is running"):
            bench.simulation.set(fixture=right)


def test_the_channel_survives_what_is_no_order_and_what_is_no_channel_is_told():
    data = load_profile("cim-tr-97-06").data

    def answer(server: socket.socket, reply: bytes) -> None:
        link, _ = server.accept()
        with link:
            link.recv(100)
            link.sendall(reply)

    with emulator() as found, socket.create_server(("127.0.0.1", 0)) as server:
        address, control = str(found["address"]), str(found["control"])
        host, _, port = control.removeprefix("tcp://").rpartition(":")
        assert host == "127.0.0.1"
        for line in NO_ORDER:
            with socket.create_connection((host, int(port)), timeout=60.0) as link:
                link.sendall(line)
                assert json.loads(link.makefile().readline())["refused"]
        with open_bench(data, address=address, control=control):
            pass
        wrong = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        for reply in NO_CHANNEL:
            thread = threading.Thread(target=answer, args=(server, reply), daemon=True)
            thread.start()
            with (
                pytest.raises(DeviceError, match="control channel") as caught,
                open_bench(data, address=address, control=wrong),
            ):
                pass
            assert "--control" in caught.value.fix
            thread.join(60.0)
