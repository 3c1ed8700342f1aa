"""Walk through a calibration: questions, readings, doubts, journal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from hdbench.devices.bench import Bench, SafeState
from hdbench.errors import Stopped
from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.conversation import (
    Answer,
    Conversation,
    LiveReading,
    Question,
    Reply,
)
from hdbench.session.calibrating.plausibility import Expectation, doubt_about
from hdbench.session.calibrating.points import PREPARATIONS, Point
from hdbench.session.calibrating.reading import BridgeReader, Taken, reading_entry
from hdbench.session.calibrating.settling import Judgement, SettledReading, SettleRule, settle_rule
from hdbench.session.calibrating.state import CalibrationLog, CalibrationState, Mounting
from hdbench.session.stop import StopSignals

_ALL = (Answer.ACCEPT, Answer.REPEAT, Answer.BACK, Answer.SKIP, Answer.QUIT)


def lock_question() -> Question:
    """Ask for the locked wave generator."""
    return Question(
        "lock",
        "Lock the wave generator with the locking shaft and mount the arm.",
        (Answer.ACCEPT, Answer.QUIT),
    )


def place_question(point: Point) -> Question:
    """Ask for the flexspline position of a point."""
    degrees = math.degrees(point.position_rad)
    return Question(
        "place",
        f"Weights off. Bring the flexspline to position {point.position_index} of "
        f"{point.position_count}: {degrees:.1f} degrees, and lock again.",
        (Answer.ACCEPT, Answer.QUIT),
    )


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
    return Question("hang", f"{point.label}: {what}{expected}", _ALL)


def still_question(point: Point, waited_s: float, spread_nm: float) -> Question:
    """Ask what to do with a reading that does not settle."""
    return Question(
        "time-out",
        f"{point.label}: not steady after {waited_s:.0f} s (the reading moves by "
        f"{spread_nm:.3f} N m). Take its average as it is, marked?",
        _ALL,
    )


def wrong_question(point: Point, problem: str) -> Question:
    """Ask what to do with a reading that does not fit its weight."""
    wanted = "no weight" if point.mass_kg == 0.0 else f"{point.mass_kg:g} kg"
    wanted = "the shunt resistor on" if point.role == "shunt" else wanted
    text = f"{problem} Asked for: {wanted}, {point.direction} side."
    return Question("gross-error", text, _ALL, default=Answer.REPEAT)


def last_question(taken: int, skipped: int) -> Question:
    """Ask whether everything is done."""
    left = f", {skipped} skipped" if skipped else ""
    return Question(
        "last",
        f"{taken} readings taken{left}. Finish the calibration?",
        (Answer.ACCEPT, Answer.REPEAT, Answer.BACK, Answer.QUIT),
    )


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


def live_reading(
    point: Point, judged: Judgement, rule: SettleRule, waited_s: float, torque_nm: float
) -> LiveReading:
    """Return what a person sees of one moment."""
    needed_s = rule.window * rule.period_s
    earliest_s = rule.read_after * rule.period_s + needed_s
    return LiveReading(
        label=point.label,
        value_v=judged.value_v,
        slope_v_s=judged.slope_v_s,
        spread_v=judged.spread_v,
        torque_nm=torque_nm,
        share=judged.share,
        remaining_s=max((1.0 - judged.share) * needed_s, earliest_s - waited_s),
        waited_s=waited_s,
        limit_s=rule.limit * rule.period_s,
        swing_period_s=None if judged.swing is None else judged.swing.period_s,
    )


@dataclass(slots=True)
class CalibrationWalk:
    """One calibration on one bench."""

    profile: ProfileData
    bench: Bench
    log: CalibrationLog
    talk: Conversation
    mounting: Mounting
    stop: StopSignals
    progress: Callable[[str, float], None]
    where: str
    clock: Callable[[], float] | None = None
    safe: SafeState | None = field(default=None, init=False)
    reader: BridgeReader = field(init=False)
    _before_s: float = field(init=False)

    def __post_init__(self) -> None:
        self.reader = BridgeReader(self.profile, self.bench, self.stop)
        self._before_s = self.log.state.time_s

    def run(self) -> None:
        """Walk to the end; the bench is safe afterwards, whatever happened."""
        state = self.log.state
        try:
            self.mounting.restore()
            if state.locked:
                self.talk.tell(left_line(state))
            while True:
                self.stop.check()
                pending = state.pending()
                if pending:
                    self.progress(pending[0].describe(), 1.0 - len(pending) / len(state.points))
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
        if not self.talk.attended:
            reply = self.talk.ask(question)
        else:
            with self.stop.interruptible():
                reply = self.talk.ask(question)
        if reply.answer is Answer.QUIT:
            self._quit()
        return reply

    def _quit(self) -> None:
        state = self.log.state
        self.log.note("saved", {"time_s": self._time_s()})
        raise Stopped(
            f"saved: {len(state.standing)} readings taken, {len(state.pending())} points to go",
            where=self.where,
            fix=f"go on with: hdbench runs resume {self.where}",
            exit_code=130,
        )

    def _finished(self) -> bool:
        state = self.log.state
        if not self.talk.attended:
            return True
        reply = self._ask(last_question(len(state.standing), len(state.skipped)))
        if reply.answer is not Answer.ACCEPT:
            self._turn(reply.answer, None)
        return reply.answer is Answer.ACCEPT

    def _turn(self, wanted: Answer, point: Point | None) -> None:
        """Do what a person asked for instead of the next reading."""
        if wanted is Answer.QUIT:
            self._quit()
        if wanted is Answer.SKIP and point is not None:
            self.log.note("skipped", {"point": point.number})
            self.talk.tell(f"skipped: {point.label}")
            return
        earlier = self.log.state.before(point)
        if earlier is None:
            self.talk.tell("no reading to go back to at this position and side")
            return
        self.log.note("reopened", {"point": earlier.number, "why": wanted.value})
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
            self.mounting.put(point, reply.mass_kg)
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
            self._ask(lock_question())
            self.mounting.lock()
            self.reader.remount()
        if state.position_rad != point.position_rad:
            self._ask(place_question(point))
            self.mounting.place(point)
            self.reader.remount()

    def _take(self, point: Point) -> Taken:
        state = self.log.state
        self.log.note("acquiring", {"point": point.number, "acquisitions": state.acquisitions + 1})
        expectation = self._expectation(point)
        plan = self.profile.calibration
        rule = settle_rule(plan, point.read_after_s, self.profile.sensor.gain_nm_per_v)

        def watch(judged: Judgement, waited_s: float) -> Answer | None:
            torque_nm = expectation.torque_nm(judged.value_v)
            return self.talk.watch(live_reading(point, judged, rule, waited_s, torque_nm))

        watched = self.reader.watched
        taken = self.reader.take(rule, watch)
        if watched and not self.reader.watched:
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
                spread_nm = taken.spread_v * self.profile.sensor.gain_nm_per_v
                reply = self._ask(still_question(point, taken.waited_s, spread_nm), point)
                if reply.answer is not Answer.ACCEPT:
                    return reply.answer
        doubt = doubt_about(point, taken, state, self.profile)
        if doubt is None:
            return Answer.ACCEPT
        mark, problem = doubt
        flags.append(mark)
        reply = self._ask(wrong_question(point, problem), point)
        if reply.answer is not Answer.ACCEPT:
            entry = reading_entry(point, taken, state, flags, self._time_s())
            self.log.note("rejected", {**entry, "why": problem})
        if reply.answer is Answer.REPEAT:
            self.mounting.put(point, reply.mass_kg)
        return reply.answer

    def _accept(self, point: Point, taken: Taken, flags: list[str]) -> None:
        state = self.log.state
        expectation = self._expectation(point)
        entry = reading_entry(point, taken, state, flags, self._time_s())
        if point.role in PREPARATIONS:
            self.log.note("prepared", {**entry, "role": point.role})
        else:
            self.log.reading(entry)
        line = accepted_line(point, taken.reading, expectation, flags)
        self.talk.tell(line, remarkable=bool(flags))
        if point.role == "shunt":
            self.talk.tell("Switch the shunt resistor off again.")
            self.mounting.open_shunt()

    def _expectation(self, point: Point) -> Expectation:
        return Expectation.of(point, self.log.state, self.profile.sensor.gain_nm_per_v)

    def _time_s(self) -> float:
        if self.clock is not None:
            return max(self.log.state.time_s, self.clock())
        return self._before_s + self.reader.sampled_s
