"""Register map of a bench controller node (`docs/node-protocol.md`)."""

from __future__ import annotations

from enum import IntEnum, IntFlag

from hdbench.devices.daq import Role
from hdbench.devices.registers import BLOCK_DATA_REGISTERS, Kind, Register


class State(IntEnum):
    """What the node is doing."""

    IDLE = 0
    RUNNING = 1
    FINISHED = 2
    STOPPED = 3
    TRIPPED = 4


class Command(IntEnum):
    """What can be written to `command`."""

    START = 1
    STOP = 2
    SAFE = 3


class Flag(IntFlag):
    """Bits of `block_flags` and `status_flags`."""

    OVERFLOW = 1
    RUNNING = 2
    WATCHDOG_TRIPPED = 4
    DRIVE_ENABLED = 8


class Capability(IntFlag):
    """Bits of `capabilities`."""

    SIMULATED = 1
    PROGRAM = 4


class Refusal(IntEnum):
    """Why the last refused request of this connection was refused."""

    NONE = 0
    ADDRESS = 1
    REFERENCE_LIMIT = 2
    VELOCITY_LIMIT = 3
    SAMPLE_PERIOD = 4
    SAMPLE_COUNT = 5
    WAVE = 6
    WATCHDOG_TIME = 7
    RUNNING = 8
    SESSION_HELD = 9
    TRIPPED = 10
    VALUE = 11


PROTOCOL_VERSION = 2
WORD_ORDER_TEST = 0x00112233
# words of a scan in the order of their bits in `channels`; one register each
CHANNELS: tuple[Role, ...] = ("torque", "tacho", "current", "reference", "encoder")
ENCODER_HIGH, ENCODER_LOW = 0x10, 0x20
ALL_CHANNELS = 0x3F
BLOCK_HEADER_REGISTERS = 12


def block_scans(width: int) -> int:
    """Return how many scans a full block holds."""
    return BLOCK_DATA_REGISTERS // width


def block_registers(width: int) -> int:
    """Return how many registers of the window a host reads."""
    return BLOCK_HEADER_REGISTERS + block_scans(width) * width


# register value of each wave type; 0 keeps the drive disabled
WAVES = ("none", "constant", "sine", "square", "triangle", "trapezoid", "chirp", "program")
PROGRAM_WAVE = WAVES.index("program")


def _group(start: int, access: str, *rows: tuple[str, Kind, str]) -> tuple[Register, ...]:
    """Lay `rows` of (name, kind, meaning) out from `start` without gaps."""
    group = []
    address = start
    for name, kind, meaning in rows:
        entry = Register(name, address, kind, access == "rw", meaning)
        group.append(entry)
        address += entry.size
    return tuple(group)


BLOCK = _group(
    0x0000,
    "r",
    ("block_echo", "u16", "heartbeat of the exchange that this reply answers"),
    ("block_run", "u16", "`starts` of the acquisition, modulo 65536"),
    ("block_seq", "u16", "sequence number 1..65535, then 1 again; 0: no block is ready"),
    (
        "block_flags",
        "u16",
        "bit 0 overflow, 1 running, 2 watchdog tripped, 3 drive enabled; bits 8-13: `channels`",
    ),
    ("block_scans", "u16", "scans in this block"),
    ("block_depth", "u16", "scans waiting behind this block; at least 1 while losses are untold"),
    ("block_first_index", "u32", "index of the first scan since the start; a jump counts losses"),
    ("block_encoder", "i32", "encoder at the first scan, counts"),
    ("block_crc", "u32", "CRC-32 of the ten registers before it and of the scans after it"),
    ("block_data", "scans", "scans: one register for each bit of `channels`, in their order"),
)
IDENTITY = _group(
    0x0100,
    "r",
    ("word_order", "u32", "always 0x00112233"),
    ("protocol_version", "u16", "version of this map, 2"),
    ("capabilities", "u16", "bit 0 simulated bench, 2 program; the others 0"),
    ("vendor", "text", "vendor"),
    ("model", "text", "model"),
    ("serial", "text", "serial number"),
    ("firmware", "text", "firmware version"),
)
LIMITS = _group(
    0x0140,
    "r",
    ("limit_reference_v", "f32", "largest motor reference, either sign, V"),
    ("limit_velocity_rad_s", "f32", "largest commanded motor speed, rad/s"),
    ("velocity_per_volt", "f32", "commanded motor speed per reference volt, rad/s/V"),
    ("min_period_ns", "u32", "shortest sample period, ns"),
    ("max_period_ns", "u32", "longest sample period, ns"),
    ("max_samples", "u32", "most samples of one acquisition"),
    ("watchdog_min_ms", "u16", "shortest watchdog time, ms"),
    ("watchdog_max_ms", "u16", "longest watchdog time, ms"),
    ("fifo_scans", "u16", "scans the node can hold"),
    ("block_capacity", "u16", "registers of scans in a full block, 113"),
    ("range_v", "f32", "volts at code 32768"),
    ("current_range_a", "f32", "motor amperes at code 32768"),
    ("converter_bits", "u16", "resolution of the converter, bit; codes are left-justified"),
    ("encoder_counts_per_turn", "u32", "encoder counts per motor turn"),
)
STATUS = _group(
    0x0180,
    "r",
    ("state", "u16", "0 idle, 1 running, 2 finished, 3 stopped, 4 tripped"),
    ("status_flags", "u16", "as block_flags, at this moment"),
    ("samples_ready", "u16", "scans waiting, those of an unacknowledged block included"),
    ("starts", "u16", "accepted starts since power-up, modulo 65536"),
    ("samples_taken", "u32", "scans taken since the start, lost ones included"),
    ("samples_lost", "u32", "scans lost since the start because the buffer was full"),
    ("reference_v", "f32", "motor reference at this moment, V"),
    ("velocity_rad_s", "f32", "motor speed at this moment, rad/s"),
    ("encoder_count", "i32", "encoder at this moment, counts"),
    ("device_time_ms", "u32", "device clock, ms"),
    ("mark_start_ms", "u32", "device clock at the last start, ms"),
    ("mark_stop_ms", "u32", "device clock at the end of the last acquisition, ms"),
    ("watchdog_trips", "u16", "watchdog trips since power-up"),
    ("refusal", "u16", "why this connection's last refused request was refused"),
    ("refused_address", "u16", "first register of that request"),
    ("session_state", "u16", "0 free, 1 held by this connection, 2 held by another"),
    ("status_echo", "u16", "`nonce` as this connection last wrote it"),
)
FEED = _group(
    0x1000,
    "rw",
    ("ack", "u16", "sequence number of the last block that arrived; 0: none"),
    ("heartbeat", "u16", "any changing number; each change feeds the watchdog"),
)
PARAMETERS = _group(
    0x1010,
    "rw",
    ("bias_v", "f32", "offset of the reference, V"),
    ("sample_period_ns", "u32", "sample period, ns"),
    ("n_samples", "u32", "scans to take"),
    ("amplitude_v", "f32", "amplitude of the reference, V"),
    (
        "wave",
        "u16",
        "0 none, 1 constant, 2 sine, 3 square, 4 triangle, 5 trapezoid, 6 chirp, 7 program",
    ),
    ("frequency_hz", "f32", "frequency, start frequency of a chirp, Hz"),
    ("duty", "f32", "share that is high"),
    ("rise", "f32", "share of the rise"),
    ("fall", "f32", "share of the fall"),
    ("end_frequency_hz", "f32", "end frequency of a chirp, Hz"),
    ("watchdog_ms", "u16", "host silence after which the motor reference is zeroed, ms"),
    (
        "channels",
        "u16",
        "bit 0 torque, 1 tacho, 2 current, 3 reference, 4, 5 encoder, high and low word; 0: all",
    ),
)
NONCE = _group(0x1008, "rw", ("nonce", "u16", "any number; comes back as `status_echo`"))
CONTROL = _group(0x1040, "rw", ("command", "u16", "1 start, 2 stop, 3 safe"))
SESSION = _group(
    0x1050, "rw", ("session", "u32", "token of the host that may write; 0 gives it back; reads 0")
)
PROGRAM = _group(
    0x1070,
    "rw",
    ("program_part", "u16", "which part is written, from 0; part 0 forgets the program before"),
    ("program_parts", "u16", "how many parts the program has, 1..128"),
    ("part_samples", "u32", "length of this part, scans"),
    ("part_start_v", "f32", "reference at its start, V"),
    ("part_end_v", "f32", "reference at its end, V; linear between"),
    ("part_amplitude_v", "f32", "amplitude of a sine on it, V"),
    ("part_frequency_hz", "f32", "frequency of the sine at the start, Hz"),
    ("part_end_frequency_hz", "f32", "frequency of the sine at the end, Hz"),
)
MAP = BLOCK + IDENTITY + LIMITS + STATUS + FEED + NONCE + PARAMETERS + CONTROL + SESSION + PROGRAM

_BY_NAME = {entry.name: entry for entry in MAP}
_BY_ADDRESS = {entry.address + k: entry for entry in MAP for k in range(entry.size)}


def register(name: str) -> Register:
    """Return the entry called `name`."""
    return _BY_NAME[name]


def register_at(address: int) -> Register | None:
    """Return the entry that covers `address`."""
    return _BY_ADDRESS.get(address)
