"""Stored inputs of a command: their profile, traces in N m, and where the answers go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.errors import UsageError
from hdbench.profile import Profile, load_profile, stored_profile
from hdbench.profile.scaling import rescaled, stored_scale
from hdbench.records import (
    Quantity,
    TorqueScale,
    Trace,
    input_identity,
    read_json,
    read_trace,
    resolve_input,
)
from hdbench.records.storage import disk_errors
from hdbench_cli.output import Output
from hdbench_cli.text import Lines

if TYPE_CHECKING:
    from hdbench.filter import FilterModel

DEFAULT_PROFILE = "cim-tr-97-06"


def choose_profile(name: str | None, source: Path | None, drive: str | None = None) -> Profile:
    """Return the named profile, else the stored run's own, else the default."""
    manifest: dict[str, Any] = {}
    if source is not None and (source / "run.json").is_file():
        manifest = read_json(source / "run.json", None)
    own = stored_profile(manifest, source) if source is not None and name is None else None
    profile = own or load_profile(name or DEFAULT_PROFILE)
    known = manifest.get("drive")
    named = drive or (known if isinstance(known, str) else "") or profile.drive
    return replace(profile, drive=named)


@dataclass(frozen=True, slots=True)
class Input:
    """One trace with its torque in N m, the file it came from, and the gain that scaled it."""

    source: Path
    file: Path
    trace: Trace
    scale: TorqueScale

    def identity(self) -> dict[str, Any]:
        """Return path and digest of the file, and what it was imported from."""
        return input_identity(self.file)


def read_input(
    source: Path,
    profile: Profile,
    *,
    gain: float | None,
    calibration: Path | None,
    model: FilterModel | None = None,
) -> Input:
    """Read a trace and give it its torque in N m: by --gain, calibration, run, model or profile."""
    file = resolve_input(source)
    trace = read_trace(file)
    stored = None
    if (source / "run.json").is_file():
        stored = stored_scale(read_json(source / "run.json").get("calibration"), source)
    known = None if model is None else model.torque_gain_nm_per_v
    if stored is None and model is not None and known is not None and "torque_nm" not in trace:
        origin = model.provenance.get("torque_gain_nm_per_v", "not stated")
        stored = TorqueScale(Quantity(known, 0.0), f"filter model {model.name}: {origin}")
    trace, scale = rescaled(trace, profile, calibration=calibration, stored=stored, gain=gain)
    return Input(source, file, trace, scale)


def check_out(out: Path, source: Path, file: Path) -> None:
    """Refuse to write over what was measured."""
    if out.resolve() == file.resolve() or (
        source.is_dir() and out.resolve().parent == source.resolve()
    ):
        raise UsageError(
            f"{out} belongs to the measured data; needed: another file",
            where="--out",
            fix="name a new file outside the run",
        )


def targets(out: Path, sources: Sequence[Path]) -> list[Path]:
    """Return the file to write for each input."""
    if len(sources) == 1:
        if out.is_dir():
            raise UsageError(f"{out} is a folder", where="--out", fix="name a .csv file")
        if not out.name.endswith((".csv", ".csv.gz")):
            raise UsageError(
                f"{out.name} is no .csv or .csv.gz; traces are written in these forms only",
                where="--out",
                fix=f"name {out.with_suffix('.csv').name}; hdbench export writes other formats",
            )
        return [out]
    if out.suffix in (".csv", ".gz") or out.is_file():
        raise UsageError(
            f"{out} is one file for {len(sources)} inputs; needed: a folder",
            where="--out",
            fix="name a folder, or give one input",
        )
    names = own_names(sources)
    with disk_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    return [out / f"{name}.csv" for name in names]


def own_names(sources: Sequence[Path]) -> list[str]:
    """Return the name of each input without its ending; they must differ."""
    names = [source.resolve().name.removesuffix(".gz").removesuffix(".csv") for source in sources]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise UsageError(
            f"several inputs are named {', '.join(sorted(twice))}; needed: different names",
            where="TRACE|RUN",
            fix="give them one by one, each with an --out of its own",
        )
    return names


def refuse_same_csv(csv_file: Path | None, html_file: Path | None) -> None:
    """Refuse a CSV file that a page beside it would write over."""
    if csv_file and html_file and csv_file.resolve() == html_file.with_suffix(".csv").resolve():
        raise UsageError(
            f"{csv_file} is also the name of the page's own CSV file",
            where="--csv",
            fix="give --csv another name than --html",
        )


def show_results(
    output: Output,
    bodies: Sequence[dict[str, Any]],
    out: Path | None,
    lines: Callable[[dict[str, Any]], Lines],
) -> None:
    """Print the result of one input, or of several as one, each under the name of its input."""
    if len(bodies) == 1:
        output.result(bodies[0], lines(bodies[0]))
        return
    each = (line for body in bodies for line in (body["input"]["path"], *lines(body)))
    header = {key: bodies[0][key] for key in ("schema", "hdbench_version", "profile")}
    files = {} if out is None else {"out": str(out)}
    output.result({**header, **files, "results": list(bodies)}, each)
