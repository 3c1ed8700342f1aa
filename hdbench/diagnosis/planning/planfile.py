"""Plan files: a motion plan as TOML or JSON, schema ``hdbench/plan/1``."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.diagnosis.planning.segments import KINDS, LoadStep, MotionPlan, Segment
from hdbench.errors import DataError
from hdbench.profile.loader import read_toml
from hdbench.profile.problems import key_text
from hdbench.profile.toml_map import Key, key_lines
from hdbench.records.jsonfile import dumps, read_json
from hdbench.records.storage import file_bytes, write_atomic

__all__ = ["PLAN_SCHEMA", "plan_text", "plan_to_dict", "read_plan", "write_plan"]

PLAN_SCHEMA = "hdbench/plan/1"
# a plan of two hours in steps of ten seconds has 720 entries and 60 kB
_LIMIT_BYTES = 256_000
_MAX_STEPS = 1000
_MAX_TEXT = 400
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
    "sweep": ("speed_rad_s", "duration_s"),
    "sine": ("speed_rad_s", "frequency_hz", "duration_s"),
    "rest": ("duration_s",),
    "load": ("text", "torque_nm"),
}
_HELP = "docs/plan.md lists kinds, keys and units"


def plan_to_dict(plan: MotionPlan) -> dict[str, Any]:
    """Return a plan as its file holds it, JSON-able.

    Parameters
    ----------
    plan : MotionPlan
        Plan.

    Returns
    -------
    dict
    """
    head = {"schema": PLAN_SCHEMA, "name": plan.name, "purpose": plan.purpose}
    return {**head, "segments": [_step_dict(step) for step in plan.steps]}


def _step_dict(step: Segment | LoadStep) -> dict[str, Any]:
    if isinstance(step, LoadStep):
        body: dict[str, Any] = {"kind": "load", "text": step.text, "torque_nm": step.torque_nm}
        lock = {"locked": True, "position_rad": step.position_rad} if step.locked else {}
        return body | lock
    body = {"kind": step.kind} | {key: getattr(step, key) for key in _NEEDED[step.kind]}
    return body | ({"note": step.note} if step.note else {})


def plan_text(plan: MotionPlan) -> str:
    """Return a plan as TOML, which `read_plan` reads back as the same plan.

    Parameters
    ----------
    plan : MotionPlan
        Plan.

    Returns
    -------
    str
    """
    body = plan_to_dict(plan)
    lines = [f"{key} = {_toml(body[key])}" for key in ("schema", "name", "purpose")]
    for step in body["segments"]:
        lines += ["", "[[segments]]", *(f"{key} = {_toml(value)}" for key, value in step.items())]
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def write_plan(path: Path, plan: MotionPlan) -> None:
    """Write a plan file, as JSON where the name ends so and as TOML elsewhere.

    Parameters
    ----------
    path : Path
        File.
    plan : MotionPlan
        Plan.
    """
    as_json = Path(path).suffix.lower() == ".json"
    text = dumps(plan_to_dict(plan)) if as_json else plan_text(plan)
    write_atomic(Path(path), text.encode("utf-8"))


def read_plan(path: Path) -> MotionPlan:
    """Read a plan file; its numbers are held against no bench yet.

    Parameters
    ----------
    path : Path
        A TOML file, or a JSON file whose name ends in ``.json``.

    Returns
    -------
    MotionPlan

    Raises
    ------
    DataError
        If the file cannot be read or is no plan; ``problems`` holds every problem with file, key
        and, for TOML, line.
    """
    path = Path(path)
    raw = file_bytes(path, limit=_LIMIT_BYTES, what="plan file")
    if path.suffix.lower() == ".json":
        return _Reader(str(path), {}).plan(read_json(path))
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise DataError("not UTF-8 text", where=f"{path}:{line}", fix="save it as UTF-8") from None
    try:
        body = read_toml(text, str(path))
    except DataError as error:
        raise DataError(error.what, where=error.where, fix=f"correct the plan; {_HELP}") from error
    return _Reader(str(path), key_lines(text)).plan(body)


@dataclass(frozen=True, slots=True)
class _Reader:
    """Checks the content of one file and collects what is wrong with it."""

    path: str
    lines: Mapping[Key, int]

    def plan(self, body: Mapping[str, Any]) -> MotionPlan:
        found: list[DataError] = []
        if body.get("schema") != PLAN_SCHEMA:
            what = f"found {body.get('schema')!r:.60}; needed: {PLAN_SCHEMA!r}"
            raise self.error(("schema",), what)
        self.unknown((), body, ("schema", "name", "purpose", "segments"), found)
        name = self.text((), body, "name", found, default=Path(self.path).stem)
        purpose = self.text((), body, "purpose", found, default="")
        entries = body.get("segments")
        if not isinstance(entries, list) or not 1 <= len(entries) <= _MAX_STEPS:
            shown = f"{len(entries)} entries" if isinstance(entries, list) else "no list"
            needed = f"1 to {_MAX_STEPS} tables [[segments]]"
            raise self.error(("segments",), f"found {shown}; needed: {needed}")
        steps = [self.step(index, entry, found) for index, entry in enumerate(entries)]
        if found:
            first, what = found[0], "; ".join(each.what for each in found[:5])
            what = f"{len(found)} problems: {what}" if len(found) > 1 else what
            raise DataError(what, where=first.where, fix=first.fix, problems=tuple(found))
        return MotionPlan(name, tuple(step for step in steps if step is not None), purpose)

    def step(self, index: int, entry: Any, found: list[DataError]) -> Segment | LoadStep | None:
        base: Key = ("segments", index)
        if not isinstance(entry, dict):
            found.append(self.error(base, f"found {entry!r:.40}; needed: a table"))
            return None
        kind = entry.get("kind")
        if kind not in (*KINDS, "load"):
            kinds = ", ".join((*KINDS, "load"))
            found.append(self.error((*base, "kind"), f"found {kind!r:.40}; needed: one of {kinds}"))
            return None
        before = len(found)
        load = kind == "load"
        extra = ("locked", "position_rad") if load else ("note",)
        self.unknown(base, entry, ("kind", *_NEEDED[kind], *extra), found)
        given = [key for key in (*_NEEDED[kind], *extra) if key in entry or key in _NEEDED[kind]]
        values = {k: self.number(base, entry, k, found) for k in given if k in _NUMBERS}
        words = self.text(base, entry, "text" if load else "note", found, None if load else "")
        locked = entry.get("locked", False)
        if load and not isinstance(locked, bool):
            what = f"found {locked!r:.40}; needed: true or false"
            found.append(self.error((*base, "locked"), what))
        if len(found) > before:
            return None
        return (
            LoadStep(words, locked=locked, **values)
            if load
            else Segment(kind, note=words, **values)
        )

    def number(
        self, base: Key, entry: Mapping[str, Any], key: str, found: list[DataError]
    ) -> float:
        value, (largest, unit) = entry.get(key), _NUMBERS[key]
        low = "above 0" if key in _POSITIVE else f"{-largest:g}"
        needed = f"a number from {low} to {largest:g} {unit}"
        if key not in entry:
            found.append(self.error((*base, key), f"missing; needed: {needed}"))
            return math.nan
        if isinstance(value, int | float) and not isinstance(value, bool):
            in_range = -largest <= value <= largest
            if in_range and (value > 0.0 or key not in _POSITIVE):
                return float(value)
        found.append(self.error((*base, key), f"found {value!r:.40}; needed: {needed}"))
        return math.nan

    def text(
        self,
        base: Key,
        entry: Mapping[str, Any],
        key: str,
        found: list[DataError],
        default: str | None = None,
    ) -> str:
        value = entry.get(key, default)
        if isinstance(value, str) and len(value) <= _MAX_TEXT and (value.isprintable()):
            return value
        needed = f"text in one line of at most {_MAX_TEXT} characters"
        shown = "nothing" if value is None else repr(value)[:40]
        found.append(self.error((*base, key), f"found {shown}; needed: {needed}"))
        return ""

    def unknown(
        self, base: Key, entry: Mapping[str, Any], known: tuple[str, ...], found: list[DataError]
    ) -> None:
        for key in entry:
            if key not in known:
                near = difflib.get_close_matches(str(key), known, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                what = f"unknown key{hint} known here: {', '.join(known)}"
                found.append(self.error((*base, key), what))

    def error(self, key: Key, what: str) -> DataError:
        place = key
        while place and place not in self.lines:
            place = place[:-1]
        line = f":{self.lines[place]}" if place in self.lines else ""
        return DataError(
            f"key {key_text(key)}: {what}",
            where=f"{self.path}{line}",
            fix=f"correct the key; {_HELP}",
        )
