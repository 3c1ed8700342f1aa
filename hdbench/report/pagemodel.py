"""Page model: sections, key numbers, figures and tables that page, CSV and JSON are made from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from hdbench.records import Quantity
from hdbench.report.numbers import plain
from hdbench.report.texts import declared, expression, figure_texts, filled
from hdbench.results.calibration import ExpandedGain
from hdbench.results.diagnosis import ParameterValue

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Level = Literal["good", "look", "bad"]


@dataclass(frozen=True, slots=True)
class KeyNumber:
    """One number worth knowing: `quantity` is its key in the result, `source` its run and key."""

    label: str
    quantity: str
    value: float
    unit: str
    source: str
    std: float | None = None
    dof: float | None = None
    note: str = ""

    def interval(self) -> tuple[float, float] | None:
        """Return the 95 % interval, or None where no uncertainty is known."""
        if not self.std:
            return None
        return Quantity(self.value, self.std, self.dof).interval()

    @classmethod
    def rows(
        cls, rows: Iterable[tuple[object, str, str, str]], run_id: str
    ) -> tuple[KeyNumber, ...]:
        """Return the key numbers of a run (entry, label, key, unit) that its result holds."""
        made = (
            key_number(body, label, key, unit, f"{run_id}: {key}")
            for body, label, key, unit in rows
        )
        return tuple(number for number in made if number is not None)


def key_number(body: object, label: str, quantity: str, unit: str, source: str) -> KeyNumber | None:
    """Return a key number from a result's entry; None where that is no number."""
    std = dof = None
    if isinstance(body, Mapping):
        std, dof, body = body.get("std"), body.get("dof"), body.get("value")
    elif isinstance(body, Quantity | ExpandedGain):
        std, dof, body = body.std, body.dof, body.value
    elif isinstance(body, ParameterValue):
        std, body = body.std, body.value
    if isinstance(body, bool) or not isinstance(body, int | float):
        return None
    return KeyNumber(label, quantity, float(body), unit, source, std, dof)


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer in one line, and what limits it."""

    level: Level
    text: str
    note: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure; its SVG carries a text for a person who cannot see it."""

    title: str
    caption: str
    svg: str

    @classmethod
    def drawn(cls, figure: Figure, name: str, text: str, **numbers: object) -> Picture:
        """Return a figure as inline SVG with unique names, and with its texts of ``texts.toml``."""
        from hdbench.report.canvas import draw_svg

        words = figure_texts(text, numbers)
        alt = words.get("alt", words["caption"])
        return cls(words["title"], words["caption"], draw_svg(figure, name, alt))


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head.

    `wide` takes the whole width of the page; on a narrow page the cells of a `stacked` row stand
    below each other; a `folded` table is shown when it is asked for.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    wide: bool = False
    stacked: bool = False
    folded: bool = False

    @classmethod
    def told(
        cls,
        key: str,
        items: Iterable[Any] = (),
        note: str = "",
        *,
        folded: bool = False,
        **names: object,
    ) -> Table:
        """Return a table of ``tables.toml``: one row for each item, or the rows that stand there.

        `names` are what its texts and expressions hold.
        """
        entry = declared("tables")[key]
        columns = entry.get("columns", {})
        rows = [[filled(cell, names) for cell in cells] for cells in entry.get("rows", ())]
        rows += [[_cell(text, names, item) for text in columns.values()] for item in items]
        return cls(
            entry["title"].format_map(names),
            tuple(name.format_map(names) for name in entry.get("head", columns)),
            tuple(map(tuple, rows)),
            note or entry.get("note", "").format_map(names),
            entry.get("wide", False),
            entry.get("stacked", False),
            folded or entry.get("folded", False),
        )

    @staticmethod
    def filled(*tables: Table) -> tuple[Table, ...]:
        """Return the tables that have rows."""
        return tuple(table for table in tables if table.rows)


def _cell(text: str, names: Mapping[str, object], row: Any) -> str:
    value = expression(text)(names, row=row)
    # a link stays one
    return value if isinstance(value, str) else plain(value)


@dataclass(frozen=True, slots=True)
class Section:
    """Everything about one run; `files` are name, link and SHA-256 of its raw files."""

    run_id: str
    kind: str
    title: str
    verdict: Verdict
    doubts: tuple[str, ...] = ()
    summary: str = ""
    numbers: tuple[KeyNumber, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    provenance: tuple[tuple[str, str], ...] = ()
    files: tuple[tuple[str, str, str], ...] = ()
