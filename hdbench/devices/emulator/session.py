"""Which host may write: one token, one connection."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.devices.emulator.parameters import RefusedError
from hdbench.devices.node.registers import Refusal, register

__all__ = ["FREE", "HELD", "MINE", "Session"]

FREE, MINE, HELD = 0, 1, 2
# a session whose connection is gone stays for a host that reconnects
_KEPT_S = 2.0


class Session:
    """The right to write.

    Parameters
    ----------
    clock : callable
        Monotonic clock, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._token = 0
        self._owner: int | None = None
        self._orphaned_s = 0.0

    def state(self, connection: int) -> int:
        """Return `FREE`, `MINE` or `HELD` as seen from `connection`."""
        if not self._token:
            return FREE
        return MINE if self._owner == connection else HELD

    def take(self, token: int, connection: int) -> None:
        """Take, take over (same token) or give back (0) the session."""
        if self.state(connection) == HELD and token != self._token:
            raise RefusedError(6, Refusal.SESSION_HELD, register("session").address)
        self._token = token
        self._owner = connection if token else None

    def disconnected(self, connection: int) -> None:
        """Note that a connection is gone."""
        if self._owner == connection:
            self._owner = None
            self._orphaned_s = self._clock()

    def tick(self) -> None:
        """End a session whose host has not come back."""
        orphaned = self._token and self._owner is None
        if orphaned and self._clock() - self._orphaned_s > _KEPT_S:
            self._token = 0
