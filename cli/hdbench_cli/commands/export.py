"""`hdbench export`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hdbench.filter.firmware import export_firmware
from hdbench.filter.presets import choose_filter
from hdbench.records.exporting import export_records, gather
from hdbench_cli.inputs import choose_profile, own_names
from hdbench_cli.output import Output


def export_command(
    output: Output,
    sources: tuple[Path, ...],
    kind: str | None,
    filter_name: str | None,
    out: Path,
    period_s: float | None,
    profile_name: str | None,
) -> None:
    """Write a filter model as C99 source, or the records of runs for other programs."""
    if kind is not None:
        _export_records(output, sources, kind, out, profile_name)
    elif filter_name is not None:
        _export_filter(output, filter_name, out, period_s, profile_name)


def _export_records(
    output: Output, sources: tuple[Path, ...], kind: str, out: Path, profile_name: str | None
) -> None:

    # one input alone goes straight into the folder
    places = [out] if len(sources) == 1 else [out / name for name in own_names(sources)]
    rows: list[dict[str, Any]] = []
    for source, place in zip(sources, places, strict=True):
        content = gather(source, choose_profile(profile_name, source).data.arm)
        written = export_records(content, place, kind)
        rows.append(
            {
                "source": content.attributes["source"],
                "sha256": content.attributes["sha256"],
                "file": str(written),
                "columns": {name: c.unit for name, c in content.channels.items()},
            }
        )
    body = {"folder": str(out), "format": kind, "exported": rows}
    told = [f"{row['file']}: {len(row['columns'])} columns of {row['source']}" for row in rows]
    profile = choose_profile(profile_name, sources[0])
    output.result(body, told, kind="export", profile=profile)


def _export_filter(
    output: Output, filter_name: str, out: Path, period_s: float | None, profile_name: str | None
) -> None:

    profile = choose_profile(profile_name, None)
    model = choose_filter(profile, filter_name)
    period = period_s or profile.data.daq.sample_period_s
    files = export_firmware(model, out, sample_period_s=period, source=filter_name)
    body = {
        "folder": str(out),
        "sample_period_s": period,
        "files": files,
        "filter": model.to_dict(),
    }
    told = f"{len(files)} files in {out}; `make` there runs the self-test"
    output.result(body, [told], kind="export", profile=profile)
