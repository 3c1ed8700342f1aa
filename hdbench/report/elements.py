"""What a report is made of: plain records that the page, the CSV and the JSON are written from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hdbench.records import Quantity

__all__ = ["KeyNumber", "Level", "Picture", "ReportFiles", "Section", "Table", "Verdict"]

Level = Literal["good", "look", "bad"]


@dataclass(frozen=True, slots=True)
class ReportFiles:
    """Where a report was written.

    Parameters
    ----------
    html, csv, json : Path
        The page, its key numbers as a table, and both as data.
    """

    html: Path
    csv: Path
    json: Path


@dataclass(frozen=True, slots=True)
class KeyNumber:
    """One number worth knowing.

    Parameters
    ----------
    label : str
        What it is, for a person.
    quantity : str
        What it is, for a program: the key in the result.
    value : float
        The number.
    unit : str
        Its unit; empty for a pure number.
    source : str
        Run and key that it came from.
    std : float or None
        Standard uncertainty, same unit.
    dof : float or None
        Degrees of freedom of `std`.
    note : str
        What to know beside the number.
    """

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


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer in one line.

    Parameters
    ----------
    level : {"good", "look", "bad"}
        Passed; worth a look; not to be relied on.
    text : str
        One sentence.
    note : tuple of str
        What limits it, one short sentence each.
    """

    level: Level
    text: str
    note: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure.

    Parameters
    ----------
    title : str
        Short name.
    caption : str
        What is drawn and what to see in it.
    alt : str
        The same for a person who cannot see it.
    svg : str
        Inline SVG, made by this package alone.
    """

    title: str
    caption: str
    alt: str
    svg: str


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head.

    Parameters
    ----------
    title : str
        What the table holds.
    head : tuple of str
        Column names, with units.
    rows : tuple of tuple of str
        Cells.
    note : str
        One line below it.
    wide : bool
        Take the whole width of the page.
    stacked : bool
        On a narrow page the cells of a row stand below each other; a line feed in a cell is kept.
    folded : bool
        Shown when it is asked for.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    wide: bool = False
    stacked: bool = False
    folded: bool = False


@dataclass(frozen=True, slots=True)
class Section:
    """Everything about one run.

    Parameters
    ----------
    run_id, kind, title : str
        Which run, of what kind, and the heading.
    verdict : Verdict
        Its answer.
    doubts : tuple of str
        Why its data are doubtful or incomplete, in words.
    summary : str
        One paragraph in plain language.
    numbers : tuple of KeyNumber
        Key numbers.
    pictures : tuple of Picture
        Figures.
    tables : tuple of Table
        Tables, the filter among them.
    provenance : tuple of (str, str)
        What was done, with what.
    files : tuple of (str, str, str)
        Name, link and SHA-256 of the raw files.
    """

    run_id: str
    kind: str
    title: str
    verdict: Verdict
    doubts: tuple[str, ...]
    summary: str
    numbers: tuple[KeyNumber, ...]
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]
    provenance: tuple[tuple[str, str], ...]
    files: tuple[tuple[str, str, str], ...]
