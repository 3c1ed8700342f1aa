"""Walk through a calibration: questions, readings, doubts, journal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from hdbench.devices.bench import Bench, SafeState
from hdbench.errors import Stopped
from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.conversation import Answer, Conversation, Question, Reply
from hdbench.session.calibrating.plausibility import Expectation, doubt_about
from hdbench.session.calibrating.points import PREPARATIONS, Point
from hdbench.session.calibrating.questions import (
    accepted_line,
    hang_question,
    last_question,
    left_line,
    live_reading,
    lock_question,
    place_question,
    still_question,
    wrong_question,
)
from hdbench.session.calibrating.reading import BridgeReader, Taken, reading_entry
from hdbench.session.calibrating.settling import Judgement, settle_rule
from hdbench.session.calibrating.state import CalibrationLog, Mounting
from hdbench.session.stop import StopSignals


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
