"""`hdbench report`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output


def report_command(
    output: Output, runs: tuple[Path, ...], out: Path | None, fleet: bool, profile_name: str | None
) -> None:
    """Write runs as one offline HTML file with CSV and JSON."""
    from hdbench.report import write_report

    profile = choose_profile(profile_name, None)
    alone = runs[0] if len(runs) == 1 and runs[0].is_dir() else Path()
    if fleet:
        from hdbench.report.fleet import fleet_runs, write_fleet

        files = write_fleet(fleet_runs(runs), out or alone / "fleet.html")
    else:
        files = write_report(runs, out or alone / "report.html", profile=profile)
    body = {name: str(path) for name, path in asdict(files).items()}
    output.result(body, [f"report  {files.html}"], kind="report-files", profile=profile)
