"""The one way to the safe state: in which order, and what it takes for proof."""

import math
from dataclasses import dataclass, field

import pytest
from daqkit import Clock

from hdbench.devices.safestate import Seen, reach_safe_state
from hdbench.errors import DeviceError


@dataclass
class Device:
    """A motor that brakes within `coast_s` of reference zero, or stops when it is disabled."""

    clock: Clock
    coast_s: float = 0.3
    stuck: str = ""
    done: list = field(default_factory=list)
    stopped_s: float = float("inf")
    on: bool = True

    def stop(self):
        self.done.append("stop")
        if self.stuck == "reference":
            raise DeviceError("no answer", where="device", fix="mend it")
        self.stopped_s = min(self.stopped_s, self.clock.now_s)

    def look(self):
        turns = self.on and self.clock.now_s < self.stopped_s + self.coast_s
        return Seen(0.0, 100.0 if turns else 0.0)

    def disable(self):
        self.done.append("disable")
        self.on = self.stuck == "enable"
        return not self.on


def reach(device, **changes):
    return reach_safe_state(
        stop=device.stop,
        look=device.look,
        disable=device.disable,
        zero_v=0.01,
        clock=device.clock,
        sleep=device.clock.sleep,
        **changes,
    )


def test_the_drive_brakes_before_it_is_disabled():
    device = Device(Clock())
    safe = reach(device)
    assert safe.confirmed
    assert safe.detail == "motor reference zero, drive disabled, motor standing"
    assert device.clock.now_s >= device.stopped_s + 0.3
    assert device.done[-1] == "disable"


def test_a_motor_that_does_not_brake_is_disabled_after_a_second():
    device = Device(Clock(), coast_s=60.0)
    start_s = device.clock.now_s
    assert reach(device).confirmed
    assert 1.0 <= device.clock.now_s - start_s < 1.2


def test_without_reference_zero_the_drive_is_disabled_at_once_and_nothing_is_confirmed():
    device = Device(Clock(), stuck="reference")
    safe = reach(device)
    assert device.done[:2] == ["stop", "disable"]
    assert (safe.confirmed, safe.detail) == (False, "no answer")
    assert not device.on


@pytest.mark.parametrize("brake_s", [0.0, 0.5])
def test_the_profile_may_ask_for_time_to_brake(brake_s):
    device = Device(Clock(), coast_s=0.0)
    start_s = device.clock.now_s
    assert reach(device, brake_s=brake_s).confirmed
    assert device.clock.now_s - start_s == pytest.approx(brake_s, abs=0.1)


def test_a_drive_that_stays_enabled_and_a_speed_that_is_no_number_are_not_confirmed():
    assert reach(Device(Clock(), stuck="enable")).detail == "the drive is still enabled"
    device = Device(Clock())
    for seen in (Seen(0.0, math.nan), Seen(math.nan, 0.0)):
        device.look = lambda seen=seen: seen
        assert not reach(device).confirmed


def test_a_device_that_measures_no_speed_does_not_say_that_the_motor_stands():
    device = Device(Clock())
    device.look = lambda: Seen(0.0)
    safe = reach(device)
    assert (safe.confirmed, safe.velocity_rad_s) == (True, None)
    assert "standing" not in safe.detail
