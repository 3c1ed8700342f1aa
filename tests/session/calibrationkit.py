"""A calibration without a wire: a scripted person, hands that set the fake bench, a journal."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from changing import with_keys
from fakes import WHOLE, FakeBench, opened, task_in

from hdbench.records.journal import read_journal
from hdbench.session import Plan
from hdbench.session.calibrating.conversation import Answer, Question, Reply, Unattended
from hdbench.session.calibrating.plan import calibration_points
from hdbench.session.calibrating.walk import CalibrationWalk
from hdbench.session.stop import StopSignals

_SHORT = {"positions": 1, "directions": ("cw",), "ranges": ("low",)}
PROFILE = with_keys(WHOLE.data, calibration={**_SHORT, "low_masses_kg": (0.0, 0.5, 1.0)})
LEVER = PROFILE.arm.gravity_m_s2 * PROFILE.arm.length_m
GAIN = PROFILE.sensor.gain_nm_per_v


@dataclass
class FakeHands:
    """Hangs weights on the fake bench; `wrong` maps a point to the mass hung at first."""

    bench: FakeBench = field(default_factory=FakeBench)
    wrong: dict[int, float] = field(default_factory=dict)
    changes: list[dict[str, float]] = field(default_factory=list)
    restored: list[dict[str, float]] = field(default_factory=list)
    shunts: list[bool] = field(default_factory=list)

    def mount(self, *, locked: bool, position_rad: float) -> None:
        self._set(0.0)

    def put(self, mass_kg: float, *, direction: str, number: int, attempt: int) -> None:
        hung = self.wrong.get(number, mass_kg) if attempt == 1 else mass_kg
        self._set((1.0 if direction == "cw" else -1.0) * hung)

    def shunt(self, *, closed: bool) -> bool:
        self.shunts.append(closed)
        self.bench.level_v = 1.0 if closed else 0.0
        return True

    def history(self) -> list[dict[str, float]]:
        return self.changes

    def restore(self, history: list[dict[str, float]], acquisitions: int) -> None:
        self.restored = list(history)
        self.changes = list(history)
        if history:
            self.bench.level_v = history[-1]["level_v"]

    def _set(self, mass_kg: float) -> None:
        self.bench.level_v = mass_kg * LEVER / GAIN
        self.changes.append({"level_v": self.bench.level_v})


class Scripted:
    """Answers from a list; Enter when it is used up. Keeps every question and line."""

    attended = True

    def __init__(self, answers: Iterable[tuple[str, Answer | Reply]] = ()) -> None:
        self.answers = list(answers)
        self.questions: list[Question] = []
        self.told: list[str] = []
        self.keys: dict[int, Answer] = {}
        self.looks = 0

    def ask(self, question: Question) -> Reply:
        self.questions.append(question)
        assert len(self.questions) < 100, "asked for ever"
        for index, (pattern, answer) in enumerate(self.answers):
            if pattern in question.text:
                del self.answers[index]
                return answer if isinstance(answer, Reply) else Reply(answer)
        return Reply(question.default)

    def watch(self, live) -> Answer | None:
        self.looks += 1
        return self.keys.pop(self.looks, None)

    def tell(self, line: str, *, remarkable: bool = False) -> None:
        self.told.append(line)

    def asked(self, topic: str) -> list[str]:
        return [question.text for question in self.questions if question.topic == topic]


def make_walk(
    folder: Path,
    *,
    talk=None,
    bench: FakeBench | None = None,
    hands: FakeHands | None = None,
    stop: StopSignals | None = None,
    profile=PROFILE,
    points=None,
) -> CalibrationWalk:
    """Return a walk over the journal in `folder`, resumed where there is one."""
    folder.mkdir(exist_ok=True)
    hands = hands or FakeHands()
    bench = hands.bench = bench or hands.bench
    plan = Plan("calibration", tuple(points or calibration_points(profile)), 0.0)
    journal, content = opened(folder)
    whole = replace(WHOLE, data=profile)
    task = task_in(folder, plan, profile=whole, stop=stop, content=content)
    return CalibrationWalk(task, bench, journal, talk or Unattended(), hands)


def blocks(folder: Path) -> list[tuple[str, dict]]:
    return [(b.kind, b.extra) for b in read_journal(folder / "journal.hdj").blocks]


def walked(folder: Path, **changes) -> CalibrationWalk:
    """Walk to the end, whatever that is, and close the journal as the end of a process would."""
    walk = make_walk(folder, **changes)
    try:
        walk.run()
    finally:
        walk.log._journal.close()
    return walk
