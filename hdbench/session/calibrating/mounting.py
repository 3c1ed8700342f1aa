"""What is on the bench: lock, position, weight; noted as it changes."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.conversation import Hands
from hdbench.session.calibrating.points import Point
from hdbench.session.calibrating.state import CalibrationLog

__all__ = ["Mounting"]


@dataclass(frozen=True, slots=True)
class Mounting:
    """Has things moved at a simulated bench, and notes what the person confirmed at any.

    Parameters
    ----------
    profile : ProfileData
        Tare of the arm.
    log : CalibrationLog
        Journal and state.
    hands : Hands or None
        Who moves things at a simulated bench; None at a real one.
    """

    profile: ProfileData
    log: CalibrationLog
    hands: Hands | None

    def lock(self) -> None:
        """Note the locked wave generator."""
        if self.hands is not None:
            self.hands.mount(locked=True, position_rad=self.log.state.position_rad or 0.0)
        self._note_changes()
        self.log.note("locked", {"locked": True})

    def place(self, point: Point) -> None:
        """Note the position of a point."""
        if self.hands is not None:
            self.hands.mount(locked=True, position_rad=point.position_rad)
        self._note_changes()
        self.log.note("placed", {"position_rad": point.position_rad})

    def put(self, point: Point, mass_kg: float | None = None) -> None:
        """Note the weight of a point."""
        state = self.log.state
        attempt = state.attempts.get(point.number, 0) + 1
        mass = point.mass_kg if mass_kg is None else mass_kg
        mass += self.profile.arm.tare_kg if mass else 0.0
        if self.hands is not None:
            if point.role == "shunt":
                self.hands.shunt(closed=True)
            else:
                self.hands.put(
                    mass, direction=point.direction, number=point.number, attempt=attempt
                )
        self._note_changes()
        self.log.note("hung", {"point": point.number, "direction": point.direction})

    def open_shunt(self) -> None:
        """Take the shunt resistor off again."""
        if self.hands is not None:
            self.hands.shunt(closed=False)
        self._note_changes()
        self.log.note("opened")

    def restore(self) -> None:
        """Bring a simulated bench to where the journal left it."""
        if self.hands is not None:
            self.hands.restore(self.log.state.fixtures, self.log.state.acquisitions)

    def _note_changes(self) -> None:
        if self.hands is not None:
            for change in self.hands.history()[len(self.log.state.fixtures) :]:
                self.log.note("fixture", {"fixture": change})
