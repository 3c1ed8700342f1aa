"""A DAQ without a wire, and a wire without a device, on a clock that goes when told."""

import struct
from dataclasses import dataclass, field, replace

import numpy as np
from changing import REPORT, with_keys

from hdbench.devices.bench import Identity, SafeState
from hdbench.devices.daq import Capabilities, InputInfo, ScanBlock, WatchdogInfo, WatchdogState
from hdbench.devices.feasibility import HostSettings
from hdbench.devices.wire.link import ExceptionReply, FrameError
from hdbench.errors import DeviceError
from hdbench.profile.acquiring import OutputChannel

TACHO = 50.0
ROLES = ("torque", "tacho", "encoder")
ABLE = Capabilities(
    inputs=(
        InputInfo("torque", -10.0, 10.0, bits=16),
        InputInfo("tacho", -10.0, 10.0, bits=16),
        InputInfo("current", -10.0, 10.0, bits=16),
        InputInfo("reference", -10.0, 10.0, bits=16),
        InputInfo("encoder", 0.0, 65535.0, bits=16, wrap=2**16),
    ),
    max_rates_hz=(10_000.0, 5_000.0, 2_500.0, 2_000.0, 1_500.0),
    min_rate_hz=1.0,
    reference=True,
    generator=False,
    enable=True,
    watchdog=WatchdogInfo(0.1, 5.0, "write", ("reference", "enable")),
)
PROFILE = with_keys(
    REPORT,
    limits={"velocity_rad_s": 400.0, "torque_nm": 60.0, "current_a": 10.0},
    tacho={"gain_rad_s_per_v": TACHO},
    sensor={"gain_nm_per_v": 6.6},
    encoder={"counts_per_turn": 4000},
)
SETTINGS = HostSettings(PROFILE, roles=ROLES, watchdog_s=1.0, output=OutputChannel(limit_v=8.0))


@dataclass
class Clock:
    """Goes by itself by a little at every look, and when somebody sleeps."""

    now_s: float = 100.0
    step_s: float = 0.0

    def __call__(self) -> float:
        self.now_s += self.step_s
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += max(0.0, seconds)


class ScriptedLine(Clock):
    """A wire and its clock: `script` says what becomes of each request, then it is silent."""

    where = "tcp://nobody:502"
    opened = None

    def __init__(self, *script, takes_s=0.001):
        super().__init__()
        self.script = list(script)
        self.takes_s = takes_s
        self.sent_s = []
        self.untils_s = []

    def transact(self, pdu, check, until_s):
        self.sent_s.append(self.now_s)
        self.untils_s.append(until_s)
        act = self.script.pop(0) if self.script else "silent"
        if act == "silent" or self.now_s + self.takes_s >= until_s:
            self.now_s = max(self.now_s, until_s)
            raise FrameError("no valid reply in time")
        self.now_s += self.takes_s
        if isinstance(act, int):
            raise ExceptionReply(act)
        if act == "broken":
            raise FrameError("the checksum of the reply is wrong")
        return bytes((pdu[0], 2)) + struct.pack(">H", 4242)

    def close(self):
        pass


def _noting(name):
    """Return a method that notes that it was called."""
    return lambda self: self.calls.append(name)


@dataclass
class FakeDaq:
    """Keeps what is done to it; the motor follows its reference at once."""

    able: Capabilities = ABLE
    clock: Clock = field(default_factory=Clock)
    reference_v: float = 0.0
    enabled: bool = False
    tripped: bool = False
    calls: list = field(default_factory=list)
    blocks: list = field(default_factory=list)
    written: list = field(default_factory=list)
    fed_s: list = field(default_factory=list)
    period_s: float | None = None
    stuck_speed_v: float | None = None
    refuse: str = ""
    simulated: bool = True
    settings: object = None

    claim, start, stop, clear_watchdog, close = (
        _noting(name) for name in ("claim", "start", "stop", "clear", "close")
    )

    def capabilities(self):
        return self.able

    def identity(self):
        return Identity("fake", "daq", "1", "0", self.simulated)

    def configure(self, settings):
        self.calls.append("configure")
        self.settings = settings
        return settings.sample_period_s if self.period_s is None else self.period_s

    def read_block(self):
        return self.blocks.pop(0) if self.blocks else None

    def write_output(self, name, value):
        if self.refuse:
            raise DeviceError(self.refuse, where="fake", fix="mend it")
        assert name == "reference"
        self.reference_v = value
        self.written.append((self.clock.now_s, value))
        return value

    def enable(self, *, on):
        self.calls.append("enable" if on else "disable")
        self.enabled = on
        return on

    def arm_watchdog(self, time_s):
        self.calls.append("arm")
        return time_s

    def feed_watchdog(self):
        self.fed_s.append(self.clock.now_s)

    def watchdog(self):
        return WatchdogState(True, self.tripped, 1.0)

    def snapshot(self):
        volts = self.stuck_speed_v
        return {"tacho": self.reference_v if volts is None else volts}

    def safe_state(self):
        self.calls.append("safe")
        if self.refuse:
            return SafeState(False, None, None, self.refuse)
        self.reference_v, self.enabled = 0.0, False
        return SafeState(True, 0.0, None, "outputs zero")


def block(first, values, *, lost=0, read_s=(0.0, 0.0), saturated=None, roles=ROLES, **changes):
    """Return a block of values, one row per scan."""
    rows = np.array(values, dtype=float).reshape(-1, len(roles))
    flags = np.zeros(rows.shape, dtype=bool) if saturated is None else np.array(saturated)
    made = ScanBlock(first, lost, rows, flags, True, False, 0, read_s)
    return replace(made, **changes)
