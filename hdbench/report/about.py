"""Provenance of a run, its files, and the filter that it used."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from hdbench.report.elements import Table
from hdbench.report.numbers import plain
from hdbench.report.signals import filter_model_of
from hdbench.report.source import Source

__all__ = ["filter_tables", "provenance", "raw_files"]

_WORDS = {
    "kind": "experiment",
    "drive": "drive",
    "sensor": "sensor",
    "status": "status",
    "exit_reason": "ended because",
    "started_utc": "started (UTC)",
    "ended_utc": "ended (UTC)",
    "hdbench_version": "hdbench",
    "host": "computer",
}
# nested entries of run.json that say with what the run was made
_NESTED = ("device", "versions", "simulation", "source")


def provenance(source: Source) -> tuple[tuple[str, str], ...]:
    """Return what was done, when, and with what."""
    rows = [("run", source.run_id)]
    rows += [
        (words, plain(source.manifest[key]))
        for key, words in _WORDS.items()
        if source.manifest.get(key) not in (None, "")
    ]
    identity = source.manifest.get("profile") or source.result.get("profile")
    if isinstance(identity, Mapping):
        rows.append(("profile", plain(identity.get("name"))))
        rows.append(("profile SHA-256", plain(identity.get("sha256"))))
    scale = source.result.get("torque_scale") or source.detail("calibration")
    if isinstance(scale, Mapping) and source.kind != "calibration":
        rows.append(("torque gain (N·m/V)", plain(scale.get("gain_nm_per_v"))))
        rows.append(("torque gain from", plain(scale.get("source"))))
        if scale.get("sha256"):
            rows.append(("calibration SHA-256", plain(scale["sha256"])))
    for key in _NESTED:
        body = source.detail(key)
        if isinstance(body, Mapping):
            rows += [(f"{key}: {name}", plain(value)) for name, value in body.items()]
    return tuple(rows)


def raw_files(source: Source, out: Path) -> tuple[tuple[str, str, str], ...]:
    """Return name, link relative to the report, and SHA-256 of the run's files."""
    hashes = source.manifest.get("files", {})
    if source.path.is_file():
        names = [source.path.name]
    else:
        names = sorted(
            file.name
            for file in source.folder.iterdir()
            if file.is_file()
            and file.name != "report.html"
            and not file.name.startswith(".")
            and not file.name.startswith("report.")
        )
    here = out.resolve().parent
    rows = []
    for name in names:
        target = os.path.relpath((source.folder / name).resolve(), here)
        rows.append((name, quote(Path(target).as_posix()), str(hashes.get(name, ""))))
    return tuple(rows)


def filter_tables(source: Source) -> tuple[Table, ...]:
    """Return the filter used, block by block, and where each number came from."""
    found = filter_model_of(source)
    if found is None or source.kind == "calibration":
        return ()
    model, _ = found
    blocks = tuple((plain(b.order), b.role, plain(b.process_noise)) for b in model.blocks)
    others = (
        ("measurement noise R, (N·m)²", plain(model.measurement_noise)),
        ("load inertia, kg·m²", plain(model.load_inertia_kg_m2)),
        ("gear ratio", plain(model.gear_ratio)),
        ("differentiator time constant, s", plain(model.differentiator_time_constant_s)),
        ("turns with", "measured angle" if model.use_measured_angle else "velocity"),
        ("torque gain, N·m/V", plain(model.torque_gain_nm_per_v)),
    )
    origin = tuple((name, text) for name, text in model.provenance.items())
    return (
        Table(
            f"Filter used: {model.name}",
            ("motor order", "takes away", "process noise Q, (N·m)² per sample"),
            blocks,
        ),
        Table("Its other numbers", ("number", "value"), others),
        Table("Where the filter's numbers came from", ("what", "origin"), origin),
    )
