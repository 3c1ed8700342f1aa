"""Page of a report and its three files: HTML, its numbers as CSV, all of it as JSON."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench import __version__
from hdbench.errors import DataError, UsageError
from hdbench.records.csvtext import csv_text
from hdbench.records.jsonfile import result_header, write_json
from hdbench.records.storage import disk_errors, write_atomic
from hdbench.report.numbers import DASH, short
from hdbench.report.pagemodel import KeyNumber, Section
from hdbench.report.texts import TEMPLATES, page_text, templates

if TYPE_CHECKING:
    from hdbench.profile import Profile

_NUMBER_HEAD = ("quantity", "value", "std", "dof", "unit", "source")
# the first bytes of every file that a report makes hold one of these
_MARKS = {
    ".html": ("hdbench</title>",),
    ".htm": ("hdbench</title>",),
    ".csv": (
        ",".join(_NUMBER_HEAD),
        "part,group,torque_nm,name,value,unit",
        "case,key,what,expected,found,allowed,in_tolerances,regression",
        "name,series,unit,run,time_utc,value,std",
        "kind,drive,run,figure,value,std,score,outlier",
    ),
    ".json": tuple(
        f'"schema": "hdbench/{kind}/'
        for kind in ("report", "comparison", "regression", "trend", "fleet")
    ),
}
# the title stands behind the page's security policy, the schema on the first lines
_HEAD_BYTES = 4096
# a head line shows the first numbers of each run: the sections list them all
_HEADLINES = 3


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


def is_page(path: Path) -> bool:
    """Return whether a path names a page rather than a folder."""
    return path.suffix.lower() in (".html", ".htm")


def page_files(html: Path, *, option: str = "", example: str = "") -> ReportFiles:
    """Return the files of a page, with their folder made."""
    if not is_page(html):
        raise UsageError(
            f"{html.name!r} does not end in .html", where=option, fix=f"name it such as {example}"
        )
    with disk_errors(html.parent):
        html.parent.mkdir(parents=True, exist_ok=True)
    files = ReportFiles(html, html.with_suffix(".csv"), html.with_suffix(".json"))
    refuse_foreign((files.html, files.csv, files.json))
    return files


def refuse_foreign(files: Iterable[Path]) -> None:
    """Refuse to write over a file that no report made."""
    for file in files:
        if not file.exists():
            continue
        if not file.is_file():
            raise DataError(
                "not a regular file", where=str(file), fix="name another file with --out"
            )
        with disk_errors(file), file.open("rb") as stream:
            head = stream.read(_HEAD_BYTES).decode("utf-8", errors="replace")
        if head and not any(mark in head for mark in _MARKS.get(file.suffix.lower(), ())):
            raise UsageError(
                "the file exists and is no report's; a report writes .html, .csv and .json of "
                "one name",
                where=str(file),
                fix="name another file with --out, or move this one away",
            )


def numbers_csv(named: Iterable[tuple[str, KeyNumber]]) -> str:
    """Return key numbers with their names as CSV, with every digit."""
    rows = []
    for name, n in named:
        std, dof = (None if x is None else float(x) for x in (n.std, n.dof))
        rows.append((name, n.value, std, dof, n.unit, n.source))
    return csv_text(_NUMBER_HEAD, rows)


def write_page(
    files: ReportFiles,
    sections: Sequence[Section],
    table: str,
    body: Mapping[str, Any],
    *,
    title: str = "",
    noun: str = "runs",
    foot: str = "",
) -> ReportFiles:
    """Write the three files of a page.

    `title` and `foot` stand for what sections of runs have; `noun` is what they are, in the plural.
    """
    page = _page(sections, files, title or _title(sections), noun, foot or page_text("foot"))
    write_atomic(files.html, page.encode("utf-8"))
    write_atomic(files.csv, table.encode("utf-8"))
    write_json(files.json, body)
    return files


def _page(sections: Sequence[Section], files: ReportFiles, title: str, noun: str, foot: str) -> str:
    """Return template and style filled with sections, all text escaped."""
    from markupsafe import Markup

    environment = templates(autoescape=True)
    # the figures are this package's own SVG, in which every text is escaped
    environment.filters |= {
        "figure": Markup,
        "number": _number,
        "interval": _interval,
        "dof": _dof,
    }
    style, script = (
        Markup((TEMPLATES / name).read_text(encoding="utf-8")) for name in ("style.css", "zoom.js")
    )
    return environment.get_template("report.html.j2").render(
        style=style,
        script=script,
        # what the page's policy names the one script by that it lets run
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        sections=sections,
        title=title,
        overall=_overall(sections, noun),
        noun=noun.capitalize(),
        foot=foot,
        badges={"good": "In order", "look": "Look", "bad": "Not usable"},
        marks={"good": "✓", "look": "!", "bad": "✕"},
        headlines=_headlines(sections),
        csv=files.csv.name,
        json=files.json.name,
        version=__version__,
    )


def _title(sections: Sequence[Section]) -> str:
    names = {section.title for section in sections}
    return names.pop() if len(names) == 1 else "Bench report"


def _overall(sections: Sequence[Section], noun: str) -> dict[str, str]:
    levels = [section.verdict.level for section in sections]
    worst = next(level for level in ("bad", "look", "good") if level in levels)
    if len(sections) == 1:
        return {"level": worst, "text": sections[0].verdict.text}
    words = [f"{levels.count('good')} of {len(levels)} {noun} are in order"]
    if levels.count("look"):
        words.append(f"{levels.count('look')} worth a look")
    if levels.count("bad"):
        words.append(f"{levels.count('bad')} not usable")
    return {"level": worst, "text": ", ".join(words) + "."}


def _headlines(sections: Sequence[Section]) -> list[KeyNumber]:
    share = _HEADLINES if len(sections) == 1 else 1 if len(sections) > 3 else 2
    found: list[KeyNumber] = []
    for section in sections:
        sure = [n for n in section.numbers if n.std and n.unit.startswith("N m")]
        found += (sure or section.numbers)[:share]
    return found


def _number(n: KeyNumber) -> str:
    text = short(n.value, n.std)
    return f"{text} ± {short(n.std, n.std)}" if n.std else text


def _interval(n: KeyNumber) -> str:
    ends = n.interval()
    return DASH if ends is None else f"{short(ends[0], n.std)} to {short(ends[1], n.std)}"


def _dof(n: KeyNumber) -> str:
    if n.dof is None:
        return DASH
    return f"{n.dof:.3g}" if n.dof < 100.0 else f"{n.dof:.0f}"


def write_report(runs: Sequence[Path], out: Path, *, profile: Profile | None = None) -> ReportFiles:
    """Write the report of one run or of several.

    Parameters
    ----------
    runs : sequence of Path
        Run folders, result files, traces or loads files, in the order in which to show them.
    out : Path
        The HTML file, or a folder that gets ``report.html``. CSV and JSON are written beside it
        under the same name; of a calibration also its record, as ``report-record.csv``.
    profile : Profile or None
        Bench for what does not carry its own profile.

    Returns
    -------
    ReportFiles
        The three files.

    Raises
    ------
    UsageError
        If no run is named, or a file of one of these names is there that no report made.
    DataError
        If one of them is damaged or of no kind that a report knows.
    StorageError
        If the files cannot be written.

    Notes
    -----
    The page is self-contained: one script of its own, no outside request, styles and figures
    inline, and a Content-Security-Policy that allows nothing else. All text is escaped. Nothing in
    it depends on the time of writing, so that the same runs give the same bytes.
    """
    if not runs:
        raise UsageError("no run named", where="report", fix="name at least one run folder or file")
    from hdbench.report.calibration.section import record_csv
    from hdbench.report.sections import make_section
    from hdbench.report.source import load_source

    out = Path(out)
    files = page_files(out if is_page(out) else out / "report.html")
    sources = [load_source(Path(run), profile) for run in runs]
    sections = tuple(
        make_section(source, number, files.html) for number, source in enumerate(sources, start=1)
    )
    for number, source in enumerate(sources, start=1):
        if source.kind == "calibration" and source.result:
            name = f"{files.html.stem}-record{'' if len(sources) == 1 else f'-{number}'}.csv"
            record = files.html.with_name(name)
            refuse_foreign((record,))
            write_atomic(record, record_csv(source.result).encode("utf-8"))
    named = ((f"{s.kind}.{n.quantity}", n) for s in sections for n in s.numbers)
    table = numbers_csv(named)
    return write_page(files, sections, table, _as_json(sections, profile))


def _as_json(sections: Sequence[Section], profile: Profile | None) -> dict[str, Any]:
    return {
        **result_header("report", profile),
        "runs": [
            {
                "run_id": section.run_id,
                "kind": section.kind,
                "verdict": asdict(section.verdict),
                "doubts": list(section.doubts),
                "summary": section.summary,
                "numbers": [asdict(number) for number in section.numbers],
                "figures": [{"title": p.title, "caption": p.caption} for p in section.pictures],
                "provenance": dict(section.provenance),
                "files": {name: digest for name, _, digest in section.files},
            }
            for section in sections
        ],
    }
