"""Control of one device on its Modbus port: named registers, and the session of one host."""

from __future__ import annotations

import contextlib
import secrets
import struct
import threading
import time
from collections.abc import Sequence

from hdbench.devices.registers import Register, decode
from hdbench.devices.transactor import TWICE, Transactor
from hdbench.devices.wire import link
from hdbench.drivers.labjack.registers import LAST_ERROR, SESSION, error_name
from hdbench.errors import BusyError, DeviceError, HdbenchError

FUNCTION = 76
_READ, _WRITE = 0, 1
# a request or reply of the usual size: 253 bytes of function code and data
_MAX_PDU = 253

Write = tuple[Register, float]


def feedback_request(writes: Sequence[Write], reads: Sequence[Register]) -> link.Request:
    """Return a request that writes first and reads afterwards, with the check of its reply.

    Frame: kind (1 byte: 0 read, 1 write), address (2), number of registers (1), and for a write
    the values; the reply carries the values read and nothing else (LabJack, "Protocol details,
    direct Modbus TCP"). The reply has no byte count: its length is compared with what was asked.
    """
    closed = [register.name for register, _ in writes if not register.writable]
    if closed:
        raise ValueError(f"not written by this driver: {', '.join(closed)}")
    frames = [
        struct.pack(">BHB", _WRITE, register.address, register.size) + register.encode(value)
        for register, value in writes
    ]
    frames += [struct.pack(">BHB", _READ, register.address, register.size) for register in reads]
    request = bytes((FUNCTION,)) + b"".join(frames)
    size = 1 + 2 * sum(register.size for register in reads)
    if max(len(request), size) > _MAX_PDU:
        raise ValueError(f"{max(len(request), size)} bytes; a frame holds {_MAX_PDU}")

    return request, link.ReplyForm(bytes((FUNCTION,)), size)


class Refused(DeviceError):  # noqa: N818 - an error that the device itself told
    """The device refused a request."""

    code = 0


class Control(Transactor):
    """Register access; every call keeps its deadline, from any thread.

    Reads are repeated once within the deadline. Writes are sent exactly once, but for those that
    their caller calls repeatable; what became of a write without an answer has to be read back.
    """

    _kind = "LabJack"

    def read(self, *registers: Register) -> list[float | int]:
        """Return the values of registers anywhere in the map."""
        return self.feedback((), registers, repeatable=True)

    def read_block(self, registers: Sequence[Register]) -> list[float | int]:
        """Return the values of adjacent registers, by function 3."""
        request = link.read_registers(registers[0].address, sum(each.size for each in registers))
        return decoded(registers, self.ask(request, registers[0], TWICE)[2:])

    def write(self, registers: Sequence[Register], values: Sequence[float]) -> None:
        """Write adjacent registers, by function 16, sent exactly once."""
        if not all(register.writable for register in registers):
            raise ValueError(f"not written by this driver: {registers[0].name}")
        pairs = zip(registers, values, strict=True)
        raw = b"".join(register.encode(value) for register, value in pairs)
        self.ask(link.write_registers(registers[0].address, raw), registers[0], 1)

    def feedback(
        self,
        writes: Sequence[Write],
        reads: Sequence[Register] = (),
        *,
        repeatable: bool = False,
    ) -> list[float | int]:
        """Write, then read, in one transaction."""
        first = writes[0][0] if writes else reads[0]
        attempts = TWICE if repeatable else 1
        raw = self.ask(feedback_request(writes, reads), first, attempts)
        return decoded(reads, raw[1:])

    def error_at(self, register: Register, what: str, fix: str) -> DeviceError:
        """Return an error that names a register."""
        return self.error(what, f"register {register.describe()}", fix)

    def ask(self, request: link.Request, first: Register, attempts: int) -> bytes:
        """Send a request for registers and return the PDU of its reply."""
        return self.transact(lambda: request, f"register {first.describe()}", attempts)

    def _refused(self, reply: link.ExceptionReply, name: str, until_s: float) -> HdbenchError:
        """Return what the device's exception means, with its own code."""
        code = self._error_code(until_s)
        why = f": {error_name(code)}" if code else ""
        error = Refused(
            f"the device refused with {reply}{why}",
            where=self._place(name),
            fix="compare the value with the device's data sheet, section of that register",
        )
        error.code = code
        return error

    def _error_code(self, until_s: float) -> int:
        """Ask once, in what is left of the deadline, for the device's own error code."""
        request, check = link.read_registers(LAST_ERROR[0].address, 1)
        try:
            return int.from_bytes(self._link.transact(request, check, until_s)[2:], "big")
        except (link.ExceptionReply, link.FrameError):
            return 0


def decoded(registers: Sequence[Register], raw: bytes) -> list[float | int]:
    """Return the values of registers from their bytes, one behind the other."""
    values: list[float | int] = []
    for register in registers:
        values.append(decode(raw[: 2 * register.size], register.kind))
        raw = raw[2 * register.size :]
    return values


# a living host beats once per period; one that misses two and a half is taken for dead, s
_PERIOD_S = 0.5
_DEAD_S = 1.25
_LOOK_S = 0.1
_TOKEN, _BEAT = SESSION


class Session:
    """The right to write, between hosts that keep this agreement.

    The T series knows no sessions. Hosts that run hdbench write a random token to USER_RAM0_U32 and
    count USER_RAM1_U32 up from a thread of their own. A token whose count stands still belongs to a
    dead host and is taken over. Other programs do not know of it, and this beat feeds no watchdog.
    """

    def __init__(self, control: Control) -> None:
        self._control = control
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def claim(self) -> bool:
        """Take the bench; return whether a dead host had it before."""
        if self._thread is not None:
            return False
        found = self._control.read(*SESSION)
        left = found[0] != 0
        if left:
            self._wait_for_a_beat(found)
        token = secrets.randbelow(0xFFFFFFFE) + 1
        self._control.feedback(((_TOKEN, token), (_BEAT, 0)))
        # two hosts that claim at once: the later write stands, and the earlier host sees it
        time.sleep(_LOOK_S)
        if self._control.read(_TOKEN)[0] != token:
            raise self._busy("another host took the bench at the same moment")
        self._thread = threading.Thread(target=self._beat, name="labjack-session", daemon=True)
        self._thread.start()
        return left

    def release(self) -> None:
        """Give the bench back; never raises."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._ended.set()
        thread.join()
        self._ended.clear()
        # a host that has gone silent is taken for dead anyhow
        with contextlib.suppress(DeviceError):
            self._control.feedback(((_TOKEN, 0),))

    def _beat(self) -> None:
        count = 0
        while not self._ended.wait(_PERIOD_S):
            count += 1
            # the thread that measures meets the same fault and tells it
            with contextlib.suppress(DeviceError):
                self._control.feedback(((_BEAT, count % 2**32),))

    def _wait_for_a_beat(self, found: list[float | int]) -> None:
        until_s = time.monotonic() + _DEAD_S
        while time.monotonic() < until_s:
            time.sleep(_LOOK_S)
            now = self._control.read(*SESSION)
            if now[0] == 0:
                return
            if now != found:
                raise self._busy("another host holds the bench and is alive")

    def _busy(self, what: str) -> BusyError:
        where = self._control.error_at(_BEAT, what, "").where
        return BusyError(what, where=where, fix="wait until it has finished, or stop it there")
