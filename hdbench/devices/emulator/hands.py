"""The registers that stand for a person's hands at the emulated node's bench."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.machine import PlantBench
from hdbench.devices.emulator.parameters import RefusedError
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import HANDLING, Refusal

__all__ = ["SimulatedHands"]


class SimulatedHands:
    """Fixture and handling of a simulated bench.

    Parameters
    ----------
    bench : PlantBench
        The simulated bench.

    Attributes
    ----------
    fixture, handling : dict
        What was written last, by register name.
    """

    def __init__(self, bench: PlantBench) -> None:
        self._bench = bench
        self.fixture: dict[str, Value] = {
            "fixture_locked": 0,
            "fixture_direction": 1,
            "fixture_position_rad": 0.0,
            "fixture_mass_kg": 0.0,
        }
        self.handling: dict[str, Value] = dict.fromkeys((e.name for e in HANDLING), 0.0)

    def fix(self, values: Mapping[str, Value], address: int) -> None:
        """Set lock, position and weight.

        Raises
        ------
        RefusedError
            With exception 3 where a value is out of its domain.
        """
        wanted = {**self.fixture, **values}
        # chained comparisons: a NaN fails them
        if not (
            wanted["fixture_locked"] in (0, 1)
            and wanted["fixture_direction"] in (-1, 1)
            and -1e3 <= float(wanted["fixture_position_rad"]) <= 1e3
            and 0.0 <= float(wanted["fixture_mass_kg"]) <= 1e3
        ):
            raise RefusedError(3, Refusal.VALUE, address)
        self.fixture = wanted
        self._bench.set_fixture(
            locked=bool(wanted["fixture_locked"]),
            position_rad=float(wanted["fixture_position_rad"]),
            mass_kg=float(wanted["fixture_mass_kg"]),
            direction=int(wanted["fixture_direction"]),
        )

    def handle(self, values: Mapping[str, Value], address: int) -> None:
        """Set how the next weight is handled, and the shunt resistor.

        Raises
        ------
        RefusedError
            With exception 3 where a value is out of its domain.
        """
        wanted = {**self.handling, **values}
        # chained comparisons: a NaN fails them
        if not (
            0.0 <= float(wanted["handling_swing_rad"]) <= 0.5
            and 0.0 <= float(wanted["handling_release_s"]) <= 1e4
            and 0.0 <= float(wanted["handling_shunt_ohm"]) <= 1e9
        ):
            raise RefusedError(3, Refusal.VALUE, address)
        self.handling = wanted
        self._bench.set_handling(
            swing_rad=float(wanted["handling_swing_rad"]),
            release_s=float(wanted["handling_release_s"]),
            shunt_ohm=float(wanted["handling_shunt_ohm"]),
        )
