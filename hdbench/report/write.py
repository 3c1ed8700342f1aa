"""Write a report: one HTML file, its key numbers as CSV, and both as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.errors import UsageError
from hdbench.records.jsonfile import result_header, write_json
from hdbench.records.storage import storage_error, write_atomic
from hdbench.report.elements import ReportFiles, Section
from hdbench.report.ours import refuse_foreign

if TYPE_CHECKING:
    from hdbench.profile import Profile

__all__ = ["write_report"]

_CSV_HEAD = ("quantity", "value", "std", "dof", "unit", "source")


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
    The page is self-contained: no script, no outside request, styles and figures inline, and a
    Content-Security-Policy that allows nothing else. All text is escaped. Nothing in it depends on
    the time of writing, so that the same runs give the same bytes.
    """
    if not runs:
        raise UsageError("no run named", where="report", fix="name at least one run folder or file")
    from hdbench.report.calibrationcsv import record_csv
    from hdbench.report.page import render_page
    from hdbench.report.sections import make_section
    from hdbench.report.source import load_source

    files = _targets(Path(out))
    refuse_foreign((files.html, files.csv, files.json))
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
    write_atomic(files.html, render_page(sections, files).encode("utf-8"))
    write_atomic(files.csv, _numbers_csv(sections).encode("utf-8"))
    write_json(files.json, _as_json(sections, profile))
    return files


def _targets(out: Path) -> ReportFiles:
    html = out if out.suffix.lower() in (".html", ".htm") else out / "report.html"
    try:
        html.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(error, html.parent) from error
    return ReportFiles(html, html.with_suffix(".csv"), html.with_suffix(".json"))


def _numbers_csv(sections: Sequence[Section]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_CSV_HEAD)
    for section in sections:
        for n in section.numbers:
            std, dof = ("" if x is None else repr(float(x)) for x in (n.std, n.dof))
            name = f"{section.kind}.{n.quantity}"
            writer.writerow((name, repr(n.value), std, dof, n.unit, n.source))
    return text.getvalue()


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
