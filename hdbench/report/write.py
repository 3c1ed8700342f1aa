"""Write a report: one HTML file, its key numbers as CSV, and both as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.errors import UsageError
from hdbench.records.jsonfile import result_header
from hdbench.records.storage import write_atomic
from hdbench.report.page import (
    ReportFiles,
    is_page,
    numbers_csv,
    page_files,
    refuse_foreign,
    write_page,
)
from hdbench.report.pagemodel import Section

if TYPE_CHECKING:
    from hdbench.profile import Profile


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
    from hdbench.report.calibration.spreadsheet import record_csv
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
