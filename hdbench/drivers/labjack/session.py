"""Session of one host: a token and a count in memory that the device leaves to hosts."""

from __future__ import annotations

import contextlib
import secrets
import threading
from collections.abc import Callable

from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.registers import SESSION
from hdbench.errors import BusyError, DeviceError

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

    def __init__(
        self, control: Control, clock: Callable[[], float], sleep: Callable[[float], None]
    ) -> None:
        self._control = control
        self._clock = clock
        self._sleep = sleep
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
        self._sleep(_LOOK_S)
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
        until_s = self._clock() + _DEAD_S
        while self._clock() < until_s:
            self._sleep(_LOOK_S)
            now = self._control.read(*SESSION)
            if now[0] == 0:
                return
            if now != found:
                raise self._busy("another host holds the bench and is alive")

    def _busy(self, what: str) -> BusyError:
        return BusyError(
            what,
            where=f"{self._control.where}, register {_BEAT.describe()}",
            fix="wait until it has finished, or stop it there",
        )
