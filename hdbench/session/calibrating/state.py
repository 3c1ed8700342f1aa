"""State of a calibration by its journal, and what is mounted on the bench."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hdbench.devices.operator import SimulatedOperator
from hdbench.records.journal import JournalContent, JournalWriter
from hdbench.session.plans import Point


@dataclass(slots=True)
class CalibrationState:
    """What is done, what is next, and what is mounted.

    A running calibration and one that is resumed go through the same `apply`: what the journal
    does not say, neither of them knows.
    """

    points: Sequence[Point]
    standing: dict[int, Mapping[str, Any]] = field(default_factory=dict, init=False)
    prepared: dict[int, Mapping[str, Any]] = field(default_factory=dict, init=False)
    skipped: set[int] = field(default_factory=set, init=False)
    attempts: Counter[int] = field(default_factory=Counter, init=False)
    hanging: int | None = field(default=None, init=False)
    locked: bool = field(default=False, init=False)
    position_rad: float | None = field(default=None, init=False)
    mountings: int = field(default=0, init=False)
    direction: str | None = field(default=None, init=False)
    acquisitions: int = field(default=0, init=False)
    time_s: float = field(default=0.0, init=False)
    fixtures: list[dict[str, float]] = field(default_factory=list, init=False)

    def apply(self, kind: str, body: Mapping[str, Any]) -> None:
        """Take one journal block in."""
        self.acquisitions = max(self.acquisitions, int(body.get("acquisitions", 0)))
        self.time_s = max(self.time_s, float(body.get("time_s", 0.0)))
        number = int(body.get("point", 0))
        if kind == "reading":
            self.standing[number] = body
            self.skipped.discard(number)
            return
        match body.get("event"):
            case "locked":
                self.locked, self.hanging = bool(body["locked"]), None
            case "placed":
                self.position_rad, self.hanging = float(body["position_rad"]), None
                self.mountings, self.direction = self.mountings + 1, None
            case "hung":
                self.mountings += self.direction not in (None, body["direction"])
                self.hanging, self.direction = number, str(body["direction"])
                self.attempts[number] += 1
            case "opened":
                self.hanging = None
            case "prepared":
                self.prepared[number] = body
            case "reopened":
                self.standing.pop(number, None)
                self.skipped.discard(number)
                if body.get("why") == "back":
                    self.hanging = None
            case "skipped":
                self.skipped.add(number)
            case "fixture":
                self.fixtures.append(dict(body["fixture"]))

    # -- what is next ----------------------------------------------------------------------------

    def pending(self) -> list[Point]:
        """Return what is still to do, in order."""
        done = {**self.prepared, **self.standing}
        return [p for p in self.points if p.number not in done and p.number not in self.skipped]

    def before(self, point: Point | None) -> Point | None:
        """Return the reading before a point that can be taken again."""
        limit = len(self.points) + 1 if point is None else point.number
        earlier = [p for p in self.points if p.number < limit and p.role == "reading"]
        if not earlier or (point is not None and earlier[-1].mounting != point.mounting):
            return None
        return earlier[-1]

    def hangs(self, point: Point) -> bool:
        """Return whether the weight of a point hangs already: its own, or the same before it."""
        if self.hanging is None:
            return False
        now = self._point(self.hanging)
        same = (now.mounting, now.mass_kg, now.role == "shunt")
        return same == (point.mounting, point.mass_kg, point.role == "shunt")

    # -- what is expected ------------------------------------------------------------------------

    def zero_v(self, point: Point) -> float | None:
        """Return the last reading without weight in the mounting of `point` before it, V."""
        zeros = [
            zero.number
            for zero in self.points[: point.number - 1]
            if zero.number in self.standing
            and zero.mass_kg == 0.0
            and zero.mounting == point.mounting
        ]
        return float(self.standing[zeros[-1]]["reading_v"]) if zeros else None

    def rest_v(self) -> float | None:
        """Return the bridge at rest before the first weight, V; None where it was not read."""
        read = [
            float(body["reading_v"])
            for number, body in self.prepared.items()
            if self._point(number).role == "zero-check" and "reading_v" in body
        ]
        return read[0] if read else None

    def deflections(self) -> list[tuple[float, float]]:
        """Return torque (N m, not 0) and reading less its zero (V) of accepted readings."""
        zeros: dict[tuple[float, str], float] = {}
        loaded = {}
        for number in sorted(self.standing):
            point, reading_v = self._point(number), float(self.standing[number]["reading_v"])
            if not point.mass_kg:
                zeros[point.mounting] = reading_v
            elif point.mounting in zeros:
                loaded[number] = (point.torque_nm, reading_v - zeros[point.mounting])
        return [loaded[number] for number in self.standing if number in loaded]

    def _point(self, number: int) -> Point:
        return self.points[number - 1]


class CalibrationLog:
    """Writes to the journal, then into the state: never the other way round."""

    def __init__(
        self, journal: JournalWriter, points: Sequence[Point], content: JournalContent | None
    ) -> None:
        self._journal = journal
        self.state = CalibrationState(points)
        for block in () if content is None else content.blocks:
            if block.extra.get("point", 1) in range(1, len(points) + 1):
                self.state.apply(block.kind, block.extra)

    def note(self, event: str, **body: Any) -> None:
        """Note an event."""
        self.append("event", {"event": event, **body})

    def append(self, kind: str, body: Mapping[str, Any]) -> None:
        """Note an event or an accepted reading."""
        self._journal.append(kind, {}, body)
        self.state.apply(kind, body)


@dataclass(frozen=True, slots=True)
class Mounting:
    """Has things moved at a simulated bench, and notes what the person confirmed at any."""

    log: CalibrationLog
    operator: SimulatedOperator | None

    def lock(self) -> None:
        """Note the locked wave generator."""
        self._mount(self.log.state.position_rad or 0.0)
        self._note("locked", locked=True)

    def place(self, point: Point) -> None:
        """Note the position of a point."""
        self._mount(point.position_rad)
        self._note("placed", position_rad=point.position_rad)

    def put(self, point: Point, hung_kg: float) -> None:
        """Note the weight of a point, which hangs with what carries it."""
        attempt = self.log.state.attempts[point.number] + 1
        if self.operator is not None:
            if point.role == "shunt":
                self.operator.shunt(closed=True)
            else:
                self.operator.put(
                    hung_kg, direction=point.direction, number=point.number, attempt=attempt
                )
        self._note("hung", point=point.number, direction=point.direction)

    def open_shunt(self) -> None:
        """Take the shunt resistor off again."""
        if self.operator is not None:
            self.operator.shunt(closed=False)
        self._note("opened")

    def restore(self) -> None:
        """Bring a simulated bench to where the journal left it."""
        if self.operator is not None:
            self.operator.restore(self.log.state.fixtures, self.log.state.acquisitions)

    def _mount(self, position_rad: float) -> None:
        if self.operator is not None:
            self.operator.mount(locked=True, position_rad=position_rad)

    def _note(self, event: str, **body: Any) -> None:
        """Note what changed at a simulated bench, then the event."""
        if self.operator is not None:
            for change in self.operator.history()[len(self.log.state.fixtures) :]:
                self.log.note("fixture", fixture=change)
        self.log.note(event, **body)
