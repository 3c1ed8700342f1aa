"""Plan files: a motion plan as TOML or JSON, schema ``hdbench/plan/1``."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.errors import DataError
from hdbench.profile.loader import key_text
from hdbench.profile.toml_text import Key, key_lines, read_toml
from hdbench.records.jsonfile import dumps, read_json
from hdbench.records.storage import file_bytes, write_atomic

PLAN_SCHEMA = "hdbench/plan/1"
# far outside of what any bench does: bounds errors of the file; the profile's limits come later
_NUMBERS = {
    "duration_s": (86_400.0, "s"),
    "speed_rad_s": (1e5, "rad/s"),
    "frequency_hz": (1e4, "Hz"),
    "torque_nm": (1e5, "N m"),
    "position_rad": (1e4, "rad"),
}
_POSITIVE = ("duration_s", "frequency_hz")
_NEEDED = {
    "hold": ("speed_rad_s", "duration_s"),
    "ramp": ("speed_rad_s", "duration_s"),
    "sine": ("speed_rad_s", "frequency_hz", "duration_s"),
    "sweep": ("speed_rad_s", "duration_s"),
    "rest": ("duration_s",),
    "load": ("text", "torque_nm"),
}
_HELP = "docs/plan.md lists kinds, keys and units"


def plan_to_dict(plan: MotionPlan) -> dict[str, Any]:
    """Return a plan as its file holds it."""
    entries: list[dict[str, Any]] = []
    for step in plan.steps:
        kind = step.kind if isinstance(step, Segment) else "load"
        entry = {"kind": kind} | {key: getattr(step, key) for key in _NEEDED[kind]}
        if isinstance(step, LoadStep) and step.locked:
            entry |= {"locked": True, "position_rad": step.position_rad}
        if isinstance(step, Segment) and step.note:
            entry["note"] = step.note
        entries.append(entry)
    head = {"schema": PLAN_SCHEMA, "name": plan.name, "purpose": plan.purpose}
    return {**head, "segments": entries}


def plan_text(plan: MotionPlan) -> str:
    """Return a plan as TOML, which `read_plan` reads back as the same plan."""
    head = plan_to_dict(plan)
    entries = head.pop("segments")
    parts = [_lines(head), *("\n[[segments]]\n" + _lines(entry) for entry in entries)]
    return "".join(parts)


def _lines(table: Mapping[str, Any]) -> str:
    """Return text, numbers and booleans as lines of TOML, which writes them as JSON does."""
    return "".join(
        f"{key} = {json.dumps(value, ensure_ascii=False, allow_nan=False)}\n"
        for key, value in table.items()
    )


def write_plan(path: Path, plan: MotionPlan) -> None:
    """Write a plan file, as JSON where the name ends so and as TOML elsewhere."""
    as_json = path.suffix.lower() == ".json"
    text = dumps(plan_to_dict(plan)) if as_json else plan_text(plan)
    write_atomic(path, text.encode("utf-8"))


def read_plan(path: Path) -> MotionPlan:
    """Read a plan file, against no bench yet; `DataError` holds every problem with file and key."""
    # a plan of two hours in steps of ten seconds has 720 entries and 60 kB
    raw = file_bytes(path, limit=256_000, what="plan file")
    if path.suffix.lower() == ".json":
        return _Reader(path, {}).plan(read_json(path))
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise DataError("not UTF-8 text", where=f"{path}:{line}", fix="save it as UTF-8") from None
    try:
        body = read_toml(text, str(path))
    except DataError as error:
        raise DataError(error.what, where=error.where, fix=f"correct the plan; {_HELP}") from error
    return _Reader(path, key_lines(text)).plan(body)


class _Reader:
    """Checks the content of one file and collects what is wrong with it."""

    def __init__(self, path: Path, lines: Mapping[Key, int]) -> None:
        self.path, self.lines = path, lines
        self.problems: list[DataError] = []

    def plan(self, body: Mapping[str, Any]) -> MotionPlan:
        if body.get("schema") != PLAN_SCHEMA:
            what = f"found {body.get('schema')!r:.60}; needed: {PLAN_SCHEMA!r}"
            raise self.error(("schema",), what)
        self.check_keys((), body, ("schema", "name", "purpose", "segments"))
        name = self.value((), "name", body, self.path.stem)
        purpose = self.value((), "purpose", body, "")
        entries = body.get("segments")
        if not isinstance(entries, list) or not 1 <= len(entries) <= 1000:
            shown = f"{len(entries)} entries" if isinstance(entries, list) else "no list"
            what = f"found {shown}; needed: 1 to 1000 tables [[segments]]"
            raise self.error(("segments",), what)
        steps = [self.step(("segments", index), entry) for index, entry in enumerate(entries)]
        if self.problems:
            first, what = self.problems[0], "; ".join(each.what for each in self.problems[:5])
            if len(self.problems) > 1:
                what = f"{len(self.problems)} problems: {what}"
            raise DataError(what, where=first.where, fix=first.fix, problems=tuple(self.problems))
        return MotionPlan(name, tuple(step for step in steps if step is not None), purpose)

    def step(self, base: Key, entry: Any) -> Segment | LoadStep | None:
        """Return a step; None where something is wrong with it."""
        if not isinstance(entry, dict):
            self.tell(base, f"found {entry!r:.40}; needed: a table")
            return None
        kind = entry.get("kind")
        if not isinstance(kind, str) or kind not in _NEEDED:
            what = f"found {kind!r:.40}; needed: one of {', '.join(_NEEDED)}"
            self.tell((*base, "kind"), what)
            return None
        before = len(self.problems)
        free = {"locked": False, "position_rad": 0.0} if kind == "load" else {"note": ""}
        keys = (*_NEEDED[kind], *free)
        self.check_keys(base, entry, ("kind", *keys))
        values = {
            key: self.value(base, key, entry, free.get(key))
            for key in sorted(keys, key=lambda key: key not in _NUMBERS)
        }
        if len(self.problems) > before:
            return None
        return LoadStep(**values) if kind == "load" else Segment(kind, **values)

    def value(self, base: Key, key: str, given: Mapping[str, Any], default: Any) -> Any:
        """Return the value of a key, or the default where it is not given, after a check."""
        value: Any = given.get(key, default)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if key in _NUMBERS:
            largest, unit = _NUMBERS[key]
            positive = key in _POSITIVE
            low = "above 0" if positive else f"{-largest:g}"
            needed = f"a number from {low} to {largest:g} {unit}"
            good = number and -largest <= value <= largest and (value > 0.0 or not positive)
        elif key == "locked":
            needed, good = "true or false", isinstance(value, bool)
        else:
            needed = "text in one line of at most 400 characters"
            good = isinstance(value, str) and len(value) <= 400 and value.isprintable()
        if good:
            return float(value) if number else value
        absent = "missing" if key in _NUMBERS else "found nothing"
        shown = absent if value is None else f"found {value!r:.40}"
        self.tell((*base, key), f"{shown}; needed: {needed}")
        return None

    def check_keys(self, base: Key, entry: Mapping[str, Any], known: tuple[str, ...]) -> None:
        for key in entry:
            if key not in known:
                near = difflib.get_close_matches(str(key), known, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                self.tell((*base, key), f"unknown key{hint} known here: {', '.join(known)}")

    def tell(self, key: Key, what: str) -> None:
        self.problems.append(self.error(key, what))

    def error(self, key: Key, what: str) -> DataError:
        place = key
        while place and place not in self.lines:
            place = place[:-1]
        line = f":{self.lines[place]}" if place in self.lines else ""
        fix = f"correct the key; {_HELP}"
        return DataError(f"key {key_text(key)}: {what}", where=f"{self.path}{line}", fix=fix)
