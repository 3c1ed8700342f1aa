"""Access to a polled device: one transaction at a time, each with its deadline."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from hdbench.devices.modbus.layout import blocks_of, values_of, write_request
from hdbench.devices.registers import Register
from hdbench.devices.transactor import TWICE, Build, Transactor
from hdbench.devices.wire.link import ExceptionReply, FrameError, Link, Probe, ReplyCheck
from hdbench.errors import DeviceError, HdbenchError, ProfileError
from hdbench.profile.acquiring_modbus import ModbusAcquisition

# exceptions that mean the profile is wrong, and those that mean "later"
_WRONG_PROFILE = (1, 2, 3)
_LATER = (5, 6)
# "acknowledged, still working", and the functions that write
_TAKEN, _WRITES = 5, (5, 6, 15, 16)
# a device that is busy is asked again after this time, s
_BUSY_S = 0.02
# on a line without transaction numbers a reply may come late. A try ends after this share of the
# deadline, no read is sent for as long again, so that one lost frame costs no call; and for this
# long after a fault every read is proven by a probe, s
TRY, _LATE = 0.35, 0.35
_DOUBT_S = 2.0
# how long the link wants the line quiet then, s
QUIET_S = 0.05


class Access(Transactor):
    """Reads and writes values; every call keeps its deadline, from any thread.

    Parameters
    ----------
    link : Link
        Connection; owned from now on.
    table : ModbusAcquisition
        Deadline of one transaction, the wait for another thread's included; rest of the device
        between two requests; most registers of one read, and how many that nobody asked for may be
        read along.
    probe : callable, optional
        Of a line without transaction numbers: the who-are-you read that follows every read for 2 s
        after a fault. Replies come in the order of their requests: had a late one been taken for
        this read's, the read's own would now come in the place of the probe's.
    numbered : bool, optional
        False for a line without transaction numbers: a read is then not sent while the reply to an
        earlier request may still come, up to 0.35 deadlines after the end of that try.
    clock, sleep : callable, optional
        Monotonic clock in s, and waiting.
    """

    _kind = "Modbus"
    _fix = "check power, wiring, unit and bit rate of the device, then run `hdbench doctor`"

    def __init__(
        self,
        link: Link,
        table: ModbusAcquisition,
        *,
        probe: Probe | None = None,
        numbered: bool = True,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(link, deadline_s=table.deadline_s, clock=clock)
        self._table = table
        self._min_gap_s = table.min_gap_s
        self._sleep = sleep
        self._rested_s = 0.0
        self._probe = probe
        self._probes = 0
        self._numbered = numbered
        self._doubtful_until_s = self._late_until_s = -math.inf

    def read(self, places: Sequence[Register]) -> list[float | int]:
        """Return the values of places, read in as few requests as may be."""
        replies = {
            block: self.transact(block.request, block.name, TWICE)[2:]
            for block in blocks_of(self._table, places)
        }
        return values_of(places, replies)

    def write(self, place: Register, value: float, function: int | None = None) -> None:
        """Write one value, sent exactly once."""
        try:
            request = write_request(place, value, function)
        except ValueError as error:
            raise ProfileError(
                str(error),
                where=self._place(place.name),
                fix="correct type or scale of this register in the profile",
            ) from error
        self.transact(lambda: request, place.name, 1)

    def pause(self) -> None:
        """Give a device that is still working a moment."""
        self._sleep(_BUSY_S)

    def _ask(self, build: Build, until_s: float, *, is_read: bool) -> bytes:
        reply = self._send(*build(), until_s)
        if is_read:
            self._make_sure(until_s)
        return reply

    def _end_of_try(self, start_s: float, attempt: int, attempts: int) -> float:
        """Return until when a try may last; a read waits for late replies to others first."""
        ends_s = start_s + self._deadline_s
        if self._numbered or attempts == 1:
            return super()._end_of_try(start_s, attempt, attempts)
        wait_s = min(self._late_until_s, ends_s) - self._clock()
        if wait_s > 0.0:
            self._sleep(wait_s)
        return ends_s if attempt == attempts else self._clock() + TRY * self._deadline_s

    def _failed(self, until_s: float) -> None:
        now_s = self._clock()
        self._doubtful_until_s = now_s + _DOUBT_S
        if not now_s < until_s:
            # no reply at all: it may be late
            self._late_until_s = now_s + _LATE * self._deadline_s

    def _make_sure(self, until_s: float) -> None:
        """Let a probe follow a read, where a late reply may still be on its way."""
        if self._probe is None or not self._clock() < self._doubtful_until_s:
            return
        self._probes += 1
        try:
            self._send(*self._probe(self._probes), until_s)
        except ExceptionReply as refused:
            # a device that does not let the probe's registers be read cannot prove it
            raise FrameError(f"the check of the reply was refused: {refused}") from refused

    def _send(self, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send the request; a device that says it is busy is asked again until the deadline."""
        while True:
            rest_s = self._rested_s + self._min_gap_s - self._clock()
            if rest_s > 0.0:
                if not self._clock() + rest_s < until_s:
                    raise FrameError("no time left after the rest that the device needs")
                self._sleep(rest_s)
            try:
                return self._link.transact(pdu, check, until_s)
            except ExceptionReply as reply:
                if reply.code not in _LATER:
                    raise
                # a write that the device has taken is not sent again: it is read back
                taken = reply.code == _TAKEN and pdu[0] in _WRITES
                if taken or not self._clock() + _BUSY_S < until_s:
                    raise FrameError(str(reply)) from reply
            finally:
                self._rested_s = self._clock()
            self._sleep(_BUSY_S)

    def _refused(self, reply: ExceptionReply, name: str, until_s: float) -> HdbenchError:
        what, where = f"the device refused with {reply}", self._place(name)
        if reply.code in _WRONG_PROFILE:
            fix = "compare table, address, type and daq.numbering with the device's manual"
            return ProfileError(what, where=where, fix=fix)
        fix = "switch the device off and on, then look at its own display"
        return DeviceError(what, where=where, fix=fix)
