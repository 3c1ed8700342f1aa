"""Walk through a calibration: questions, readings, doubts, journal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from hdbench.devices import SimulatedOperator
from hdbench.devices.bench import Bench, SafeState
from hdbench.errors import Stopped
from hdbench.records import Loads
from hdbench.records.counted import journal_loads, write_sequence
from hdbench.records.journal import JournalWriter, read_journal
from hdbench.records.loads import read_sequence, write_loads
from hdbench.records.runfolder import utc_now
from hdbench.session.calibrating.conversation import (
    Answer,
    Conversation,
    LiveReading,
    Question,
    Reply,
)
from hdbench.session.calibrating.plausibility import Expectation, doubt_about
from hdbench.session.calibrating.reading import BridgeReader, Taken, reading_entry
from hdbench.session.calibrating.settling import Judgement, SettledReading, settle_rule
from hdbench.session.calibrating.state import CalibrationLog, CalibrationState, Mounting
from hdbench.session.options import Task
from hdbench.session.plans import PREPARATIONS, Point
from hdbench.session.runner import counted

_GO_OR_QUIT = (Answer.ACCEPT, Answer.QUIT)


def hang_question(point: Point, expectation: Expectation) -> Question:
    """Ask for a weight."""
    if point.role == "shunt":
        what = "Switch the shunt resistor on."
    elif point.mass_kg == 0.0:
        what = f"Take all weights off ({point.direction} side)."
    else:
        what = f"Hang {point.mass_kg:g} kg on the {point.direction} side."
    expected = ""
    if point.role in ("reading", "preload"):
        volts = expectation.volts(point.torque_nm)
        expected = f" Expect {point.torque_nm:+.3f} N m, {volts:+.3f} V."
    return Question("hang", f"{point.label}: {what}{expected}")


def wrong_question(point: Point, problem: str) -> Question:
    """Ask what to do with a reading that does not fit its weight."""
    wanted = "no weight" if point.mass_kg == 0.0 else f"{point.mass_kg:g} kg"
    wanted = "the shunt resistor on" if point.role == "shunt" else wanted
    text = f"{problem} Asked for: {wanted}, {point.direction} side."
    return Question("gross-error", text, default=Answer.REPEAT)


def left_line(state: CalibrationState) -> str:
    """Say how an earlier session left the bench."""
    hangs = "no weight" if state.hanging is None else state.points[state.hanging - 1].describe()
    return (
        f"goes on after {len(state.standing)} readings. The bench was left locked, flexspline at "
        f"{math.degrees(state.position_rad or 0.0):.1f} degrees; last on the arm: {hangs}. "
        "If that has changed, restore it."
    )


def accepted_line(
    point: Point, reading: SettledReading, expectation: Expectation, flags: list[str]
) -> str:
    """Say what was accepted."""
    swing = f", {reading.swing.period_s:.2f} s swing averaged" if reading.swing else ""
    marked = f", marked {'; '.join(flags)}" if flags else ""
    return (
        f"accepted {point.label}: {reading.mean_v:+.4f} V, "
        f"{expectation.torque_nm(reading.mean_v):+.3f} N m{swing}{marked}"
    )


@dataclass(eq=False)
class CalibrationWalk:
    """One calibration on one bench."""

    task: Task
    bench: Bench
    journal: JournalWriter
    talk: Conversation
    operator: SimulatedOperator | None

    def __post_init__(self) -> None:
        self._profile = self.task.profile.data
        self.log = CalibrationLog(self.journal, self.task.plan.points, self.task.content)
        self._mounting = Mounting(self.log, self.operator)
        self._reader = BridgeReader(self._profile, self.bench, self.task.stop)
        self._before_s = self.log.state.time_s
        # samples tell the time of a bench that does not keep real time
        self._timed = self.bench.simulation is None or bool(self.task.options.realtime)
        self.safe: SafeState | None = None

    def run(self) -> None:
        """Walk to the end; the bench is safe afterwards, whatever happened."""
        state = self.log.state
        try:
            self._mounting.restore()
            if state.locked:
                self.talk.tell(left_line(state))
            while True:
                self.task.stop.check()
                pending = state.pending()
                if pending:
                    self.task.progress(
                        pending[0].describe(), 1.0 - len(pending) / len(state.points)
                    )
                    self._visit(pending[0])
                elif self._finished():
                    return
        finally:
            self.safe = self.bench.safe_state()

    # -- asking ----------------------------------------------------------------------------------

    def _ask(self, question: Question, point: Point | None = None) -> Reply:
        if point is not None:
            place = f"{point.number} of {len(self.log.state.points)}"
            question = replace(question, progress=place)
        if self.talk.attended:
            with self.task.stop.interruptible():
                reply = self.talk.ask(question)
        else:
            reply = self.talk.ask(question)
        if reply.answer is Answer.QUIT:
            self._quit()
        return reply

    def _quit(self) -> None:
        state = self.log.state
        self.log.note("saved", time_s=self._time_s())
        where = str(self.task.folder.path)
        raise Stopped(
            f"saved: {len(state.standing)} readings taken, {len(state.pending())} points to go",
            where=where,
            fix=f"go on with: hdbench runs resume {where}",
            exit_code=130,
        )

    def _finished(self) -> bool:
        state = self.log.state
        if not self.talk.attended:
            return True
        left = f", {len(state.skipped)} skipped" if state.skipped else ""
        text = f"{len(state.standing)} readings taken{left}. Finish the calibration?"
        answers = (Answer.ACCEPT, Answer.REPEAT, Answer.BACK, Answer.QUIT)
        reply = self._ask(Question("last", text, answers))
        if reply.answer is not Answer.ACCEPT:
            self._turn(reply.answer, None)
        return reply.answer is Answer.ACCEPT

    def _turn(self, wanted: Answer, point: Point | None) -> None:
        """Do what a person asked for instead of the next reading."""
        if wanted is Answer.QUIT:
            self._quit()
        if wanted is Answer.SKIP and point is not None:
            self.log.note("skipped", point=point.number)
            self.talk.tell(f"skipped: {point.label}")
            return
        earlier = self.log.state.before(point)
        if earlier is None:
            self.talk.tell("no reading to go back to at this position and side")
            return
        self.log.note("reopened", point=earlier.number, why=wanted.value)
        self.talk.tell(f"again: {earlier.label}; its reading is kept, marked {wanted.value}")

    # -- one point -------------------------------------------------------------------------------

    def _visit(self, point: Point) -> None:
        self._mount(point)
        state = self.log.state
        if not state.hangs(point):
            expectation = self._expectation(point)
            reply = self._ask(hang_question(point, expectation), point)
            if reply.answer is not Answer.ACCEPT:
                self._turn(reply.answer, point)
                return
            self._put(point, reply)
        while True:
            taken, flags = self._take(point), list[str]()
            wanted = self._judged(point, taken, flags)
            if wanted is Answer.REPEAT:
                continue
            if wanted is Answer.ACCEPT:
                self._accept(point, taken, flags)
            else:
                self._turn(wanted, point)
            return

    def _mount(self, point: Point) -> None:
        state = self.log.state
        if not state.locked:
            text = "Lock the wave generator with the locking shaft and mount the arm."
            self._ask(Question("lock", text, _GO_OR_QUIT))
            self._mounting.lock()
            self._reader.remount()
        if state.position_rad != point.position_rad:
            text = (
                f"Weights off. Bring the flexspline to position {point.position_index} of "
                f"{point.position_count}: {math.degrees(point.position_rad):.1f} degrees, and lock "
                "again."
            )
            self._ask(Question("place", text, _GO_OR_QUIT))
            self._mounting.place(point)
            self._reader.remount()

    def _put(self, point: Point, reply: Reply) -> None:
        mass_kg = point.mass_kg if reply.mass_kg is None else reply.mass_kg
        self._mounting.put(point, mass_kg + (self._profile.arm.tare_kg if mass_kg else 0.0))

    def _take(self, point: Point) -> Taken:
        acquisitions = self.log.state.acquisitions + 1
        self.log.note("acquiring", point=point.number, acquisitions=acquisitions)
        expectation = self._expectation(point)
        profile = self._profile
        rule = settle_rule(profile.calibration, point.read_after_s, profile.sensor.gain_nm_per_v)

        def watch(judged: Judgement, waited_s: float) -> Answer | None:
            window_s = rule.window * rule.period_s
            earliest_s = rule.read_after * rule.period_s + window_s
            left_s = max((1.0 - judged.share) * window_s, earliest_s - waited_s)
            torque_nm = expectation.torque_nm(judged.value_v)
            return self.talk.watch(LiveReading(judged, torque_nm, left_s))

        watched = self._reader.watched
        taken = self._reader.take(rule, watch)
        if watched and not self._reader.watched:
            self.talk.tell(
                "this bench has no encoder: look yourself whether the lock holds", remarkable=True
            )
        return taken

    def _judged(self, point: Point, taken: Taken, flags: list[str]) -> Answer:
        """Return what is to be done with a reading; `flags` mark it if it is accepted."""
        state = self.log.state
        if taken.wanted is not None and taken.wanted is not Answer.ACCEPT:
            return taken.wanted
        if not taken.reading.settled:
            flags.append("timeout" if taken.wanted is None else "not-settled")
            if taken.wanted is None:
                spread_nm = taken.spread_v * self._profile.sensor.gain_nm_per_v
                text = (
                    f"{point.label}: not steady after {taken.waited_s:.0f} s (the reading moves by "
                    f"{spread_nm:.3f} N m). Take its average as it is, marked?"
                )
                reply = self._ask(Question("time-out", text), point)
                if reply.answer is not Answer.ACCEPT:
                    return reply.answer
        doubt = doubt_about(point, taken, state, self._profile)
        if doubt is None:
            return Answer.ACCEPT
        mark, problem = doubt
        flags.append(mark)
        reply = self._ask(wrong_question(point, problem), point)
        if reply.answer is not Answer.ACCEPT:
            entry = reading_entry(point, taken, state, flags, self._time_s())
            self.log.note("rejected", **entry, why=problem)
        if reply.answer is Answer.REPEAT:
            self._put(point, reply)
        return reply.answer

    def _accept(self, point: Point, taken: Taken, flags: list[str]) -> None:
        state = self.log.state
        expectation = self._expectation(point)
        entry = reading_entry(point, taken, state, flags, self._time_s())
        if point.role in PREPARATIONS:
            self.log.note("prepared", **entry, role=point.role)
        else:
            self.log.append("reading", entry)
        line = accepted_line(point, taken.reading, expectation, flags)
        self.talk.tell(line, remarkable=bool(flags))
        if point.role == "shunt":
            self.talk.tell("Switch the shunt resistor off again.")
            self._mounting.open_shunt()

    def _expectation(self, point: Point) -> Expectation:
        return Expectation.of(point, self.log.state, self._profile.sensor.gain_nm_per_v)

    def _time_s(self) -> float:
        if not self._timed:
            return self._before_s + self._reader.sampled_s
        started = datetime.fromisoformat(str(self.task.folder.manifest["started_utc"]))
        return max(self.log.state.time_s, (utc_now() - started).total_seconds())

    # -- what is kept -----------------------------------------------------------------------------

    def records(self) -> Loads | None:
        """Return the readings that count, as the journal has them."""
        folder = self.task.folder
        if not self.log.state.standing:
            return None
        content = read_journal(folder.journal)
        loads = journal_loads(content, str(folder.loads))
        course = read_sequence(write_sequence(folder.path, content))
        return replace(loads, metadata={**loads.metadata, "sequence": course})

    def files(self) -> list[Path]:
        """Write the readings that count, and the course of the calibration."""
        folder = self.task.folder
        files = [write_sequence(folder.path, read_journal(folder.journal))]
        records = self.records()
        if records is not None:
            write_loads(folder.loads, records)
            files.insert(0, folder.loads)
        return files

    def doubts(self) -> tuple[str, ...]:
        """Return unsettled, saturated, doubtful and skipped readings."""
        state = self.log.state
        flags = [set(str(body.get("flags", "")).split(";")) for body in state.standing.values()]
        marks = {
            "readings taken before they had settled": {"timeout", "not-settled"},
            "readings saturated": {"saturated"},
            "readings kept although they do not fit their weight": {"confirmed-gross-error"},
        }
        numbers = [(sum(bool(one & mark) for one in flags), what) for what, mark in marks.items()]
        checks = [str(body.get("flags")) for body in state.prepared.values() if body.get("flags")]
        return (
            *counted([*numbers, (len(state.skipped), "points skipped")]),
            *(f"check before the first weight: {flag}" for flag in checks),
        )
