"""Two devices as one: who samples, who drives, who guards."""

from dataclasses import replace

import numpy as np
import pytest
from changing import with_daq
from daqkit import ABLE, ROLES, SETTINGS, Clock, FakeDaq, block
from served import sampled

from hdbench.devices import AcquisitionSettings, open_bench
from hdbench.devices.composite import CompositeDaq
from hdbench.devices.daq import DaqSettings
from hdbench.devices.emulator.serving import emulated_speed
from hdbench.devices.host.bench import HostedBench
from hdbench.errors import DeviceError
from hdbench.profile import load_profile
from hdbench.profile.loader import parse_profile
from hdbench.profile.schema import ReferenceWave

WAVE = ReferenceWave(wave="constant", amplitude_v=2.0)
INPUTS = replace(ABLE, reference=False, watchdog=None, enable=False)
OUTPUTS = replace(ABLE, inputs=(), max_rates_hz=())


def pair(inputs=INPUTS, outputs=OUTPUTS):
    clock = Clock()
    one, other = FakeDaq(inputs, clock), FakeDaq(outputs, clock)
    return one, other, CompositeDaq(one, other, clock=clock)


def test_inputs_come_from_the_one_and_outputs_and_watchdog_from_the_other():
    able = pair()[2].capabilities()
    for name in ("inputs", "max_rates_hz", "reference", "watchdog"):
        assert getattr(able, name) == getattr(ABLE, name)
    assert able.guarded


def test_no_motion_without_a_watchdog_on_the_device_that_drives():
    """A watchdog of the device that samples guards nothing."""
    one, other, both = pair(ABLE, replace(OUTPUTS, watchdog=None))
    bench = HostedBench(both, SETTINGS, clock=one.clock, sleep=one.clock.sleep)
    with pytest.raises(DeviceError, match="no watchdog of the device that drives"):
        bench.configure(AcquisitionSettings(1e-3, 1000, WAVE))
    assert one.calls == other.calls == other.written == []
    bench.configure(AcquisitionSettings(1e-3, 1000, None))


def test_a_device_with_a_generator_cannot_be_the_outputs_of_another():
    _, _, both = pair(outputs=replace(OUTPUTS, generator=True))
    with pytest.raises(DeviceError, match="sample clock of its own") as caught:
        both.capabilities()
    assert caught.value.where == "key daq.outputs.driver"


def test_a_real_and_an_emulated_device_are_not_mixed():
    one, other, both = pair()
    other.simulated = False
    with pytest.raises(DeviceError, match=r"simulated.*real"):
        both.claim()
    assert one.calls == other.calls == []


def test_everything_that_moves_goes_to_the_outputs():
    one, other, both = pair()
    both.claim()
    both.configure(DaqSettings(ROLES, 1e-3, 100, 1.0))
    both.arm_watchdog(1.0)
    both.write_output("reference", 1.0)
    both.enable(on=True)
    both.feed_watchdog()
    both.start()
    both.stop()
    both.clear_watchdog()
    assert one.calls == ["claim", "configure", "start", "stop"]
    assert one.written == one.fed_s == []
    assert other.calls == ["claim", "configure", "arm", "enable", "clear"]
    assert other.reference_v == 1.0
    assert (one.settings.roles, other.settings.roles) == (ROLES, ())


def test_a_trip_of_the_outputs_shows_in_the_next_block():
    one, other, both = pair()
    one.blocks = [block(0, [[0, 0, 0]]), block(1, [[0, 0, 0]]), block(2, [[0, 0, 0]])]
    assert not both.read_block().watchdog_tripped
    other.tripped = True
    # looked at every 0.1 s
    assert not both.read_block().watchdog_tripped
    one.clock.now_s += 0.11
    assert both.read_block().watchdog_tripped


def test_the_outputs_are_made_safe_first_and_decide():
    one, other, both = pair()
    other.reference_v = 3.0
    assert both.safe_state().confirmed
    assert other.reference_v == 0.0
    one.refuse = "inputs silent"
    safe = both.safe_state()
    assert safe.confirmed
    assert "inputs silent" in safe.detail
    other.refuse = "outputs silent"
    assert not both.safe_state().confirmed


def _profile(daq):
    return parse_profile(with_daq(daq), "bench.toml")


EMBEDDED = """driver = "composite"
address = "embedded"
sample_period_s = 0.001
watchdog_s = 1.0
channels = ["torque", "tacho", "encoder"]

[daq.inputs]
driver = "labjack-t"
channels = [
    { role = "torque", input = "AIN0" },
    { role = "tacho", input = "AIN1" },
    { role = "encoder", input = "quadrature" },
]

[daq.outputs]
driver = "labjack-t"
channels = [{ role = "torque", input = "AIN0" }]

[daq.outputs.output]
output = "TDAC2"
limit_v = 8.0
update_s = 0.005
enable_line = 4
"""


def test_a_profile_describes_both_parts_with_one_period():
    named = EMBEDDED.replace('"labjack-t"', '"labjack-t"\naddress = "tcp://127.0.0.1:502"')
    table = _profile(named.replace('address = "embedded"\n', "")).data.daq
    assert table.inputs.address == "tcp://127.0.0.1:502"
    assert table.outputs.sample_period_s == table.sample_period_s == 0.001


@pytest.mark.usefixtures("patient_control")
def test_two_emulated_devices_are_one_bench():
    """The tacho follows the reference beside it by the lag of the servo, 1 / (2 pi 15 Hz)."""
    # slow and in real time: a value that a busy machine writes late is little off
    hertz = 0.5
    wave = ReferenceWave(wave="sine", amplitude_v=1.0, frequency_hz=hertz)
    with open_bench(_profile(EMBEDDED), seed=1, realtime=True) as bench:
        assert bench.identity().model == "T7 + T7"
        got = sampled(bench, AcquisitionSettings(1e-3, 2500, wave))
        doubt_s = bench._samples.doubt_s
        assert bench.safe_state().confirmed
    assert got.lost == 0
    angle = 2 * np.pi * hertz * 1e-3 * np.arange(500, 2500)
    tones = np.column_stack([np.sin(angle), np.cos(angle)])
    both = np.column_stack([got.reference_v[500:2500], got.tacho_v[500:2500]])
    sines, cosines = np.linalg.lstsq(tones, both, rcond=None)[0]
    assert np.hypot(sines, cosines)[0] == pytest.approx(1.0, abs=0.05)
    phases = np.arctan2(cosines, sines)
    lag_s = (phases[0] - phases[1]) / (2 * np.pi * hertz)
    assert lag_s == pytest.approx(1 / (2 * np.pi * 15.0), abs=0.005 + doubt_s)
    assert 0.0 < doubt_s < 0.1


@pytest.mark.parametrize(("pace", "polled", "speed"), [
    ("realtime", False, 1.0), ("realtime", True, 1.0), ("fast", True, 1.0), ("fast", False, 4.0),
])  # fmt: skip
def test_polled_inputs_are_emulated_at_the_pace_of_the_clock_that_polls_them(pace, polled, speed):
    table = load_profile("di-2108-ek9000").data.daq
    if polled:
        table = table.model_copy(update={"inputs": load_profile("seneca-z-sg").data.daq})
    assert emulated_speed(table, pace) == speed


def test_repeated_requests_of_both_devices_are_counted():
    one, other, both = pair()
    # a driver that does not count adds nothing
    assert both.repeats == 0
    one.repeats, other.repeats = 3, 4
    assert both.repeats == 7
