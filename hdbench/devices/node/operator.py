"""The operator of a simulated bench: sets the fixture as the prompts ask."""

from __future__ import annotations

from hdbench.devices.node.driver import NodeBench
from hdbench.devices.ports import Bench
from hdbench.errors import UsageError

__all__ = ["SimulatedOperator"]


class SimulatedOperator:
    """Does at once and without error what a person would be asked to do.

    Implements `hdbench.devices.ports.Operator`.

    Parameters
    ----------
    bench : Bench
        The driver of a simulated bench.

    Raises
    ------
    UsageError
        If `bench` is a real one.
    """

    def __init__(self, bench: Bench) -> None:
        if not isinstance(bench, NodeBench) or not bench.identity().simulated:
            raise UsageError(
                "a real bench needs a person beside it",
                where="bench",
                fix="run the command on a terminal, without --no-input",
            )
        self._bench = bench
        self._locked = False
        self._position_rad = 0.0

    def confirm_lock(self, *, locked: bool) -> bool:
        """Lock or release the wave generator; released, nothing hangs on the arm."""
        self._locked = locked
        self._set(0.0, 1)
        return True

    def set_position(self, position_rad: float, *, index: int, count: int) -> bool:
        """Turn the unloaded flexspline to `position_rad`, rad."""
        self._position_rad = position_rad
        self._set(0.0, 1)
        return True

    def hang(self, mass_kg: float, *, direction: str, expected_nm: float, step: str) -> bool:
        """Hang `mass_kg` on the arm for `direction` (``cw`` or ``ccw``)."""
        self._set(mass_kg, {"cw": 1, "ccw": -1}[direction])
        return True

    def confirm_motion(self, description: str) -> bool:
        """Allow the motion: nobody stands beside a simulated bench."""
        return True

    def _set(self, mass_kg: float, direction: int) -> None:
        self._bench.set_fixture(
            locked=self._locked,
            position_rad=self._position_rad,
            mass_kg=mass_kg,
            direction=direction,
        )
