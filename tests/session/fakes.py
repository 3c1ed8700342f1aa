"""A bench without a wire: logs every call, fails on demand, knows whether its motor turns."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from hdbench.devices.bench import AcquisitionSettings, Block, Identity, SafeState
from hdbench.errors import DeviceError
from hdbench.filter import FilterModel, filter_trace, preset
from hdbench.profile import load_profile
from hdbench.profile.scaling import profile_scale
from hdbench.records import Trace
from hdbench.records.journal import JournalContent, JournalWriter
from hdbench.session import BenchOptions, Plan
from hdbench.session.options import Task
from hdbench.session.stop import StopSignals

WHOLE = load_profile("cim-tr-97-06")


def quiet(_what: str, _share: float) -> None:
    """Say nothing of the progress."""


def check_filtered(trace: Trace, model: dict[str, object]) -> None:
    """Hold what a run filtered while it measured against its filter over the stored trace."""
    again = filter_trace(trace, FilterModel.from_dict(model, source="run.json"), WHOLE.data)
    np.testing.assert_array_equal(again.torque_filtered_nm, trace["torque_filtered_online_nm"])


def opened(path: Path) -> tuple[JournalWriter, JournalContent | None]:
    """Return the journal in a folder and what it holds already."""
    if (path / "journal.hdj").exists():
        return JournalWriter.resume(path / "journal.hdj")
    return JournalWriter(path / "journal.hdj"), None


def task_in(path: Path, plan: Plan, *, profile=WHOLE, stop=None, content=None) -> Task:
    """Return a run in a folder that holds nothing but its journal."""
    folder = SimpleNamespace(path=path, journal=path / "journal.hdj", trace=path / "trace.csv")
    asked = (plan.kind, profile, BenchOptions(path), plan)
    scaled = (profile_scale(WHOLE), preset("report-6", WHOLE.data))
    return Task(*asked, *scaled, folder, stop or StopSignals(), quiet, content)


@dataclass
class FakeBench:
    fail_at: str | None = None
    after: int = 0
    hook: Callable[["FakeBench", str], None] = lambda _bench, _name: None
    moving: bool = False
    confirms: bool = True
    index: int = 0
    settings: AcquisitionSettings | None = None
    level_v: float = 0.0
    count: int = 0
    velocity_v: float = 1.0
    lose_at: int | None = None
    calls: list[str] = field(default_factory=list)
    simulation = SimpleNamespace(embedded=True)

    def _call(self, name: str) -> None:
        self.calls.append(name)
        self.hook(self, name)
        if name == self.fail_at and self.calls.count(name) > self.after:
            raise DeviceError(f"{name} failed", where="fake", fix="none")

    def identity(self) -> Identity:
        return Identity("fake", "bench", "1", "1", simulated=True)

    def configure(self, settings: AcquisitionSettings) -> None:
        self._call("configure")
        self.settings = settings
        self.index = 0

    def start(self) -> None:
        self._call("start")
        self.moving = self.settings is not None and self.settings.reference is not None

    def read_block(self) -> Block | None:
        self._call("read_block")
        assert self.settings is not None
        n = min(20, self.settings.n_samples - self.index)
        if n <= 0:
            return None
        lost = 0
        if self.lose_at is not None and self.index >= self.lose_at:
            lost, self.lose_at = 5, None
            n = min(n, self.settings.n_samples - self.index - lost)
        first = self.index + lost
        self.index = first + n
        k = np.arange(first, first + n)
        speed = self.velocity_v if self.moving else 0.0
        angle = speed * 56.2565 * k * self.settings.sample_period_s
        return Block(
            first_index=first,
            lost_before=lost,
            torque_v=np.full(n, self.level_v) + 1e-4 * np.cos(0.7 * k),
            tacho_v=np.full(n, speed),
            motor_current_a=np.zeros(n),
            reference_v=np.full(n, speed),
            encoder_count=(np.floor(angle * 4000 / (2 * np.pi)) + self.count).astype(np.int64),
            saturated=np.zeros(n, dtype=bool),
            running=self.index < self.settings.n_samples,
            watchdog_tripped=False,
            depth=0,
        )

    def stop(self) -> None:
        self._call("stop")
        self.moving = False

    def safe_state(self) -> SafeState:
        self.calls.append("safe_state")
        self.moving = False
        return SafeState(self.confirms, 0.0, 0.0, "fake bench answered")

    def close(self) -> None:
        self.calls.append("close")


@dataclass
class FakeOperator:
    bench: FakeBench
    refuse: str | None = None
    asked: list[str] = field(default_factory=list)

    def _answer(self, what: str) -> bool:
        self.asked.append(what)
        return what != self.refuse

    def confirm_lock(self, *, locked: bool) -> bool:
        return self._answer("lock" if locked else "release")

    def set_position(self, position_rad: float, *, index: int, count: int) -> bool:
        return self._answer("position")

    def hang(self, mass_kg: float, *, direction: str, expected_nm: float, step: str) -> bool:
        self.bench.level_v = expected_nm / 6.6
        return self._answer("hang")

    def confirm_motion(self, description: str) -> bool:
        return self._answer("motion")
