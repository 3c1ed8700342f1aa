"""Stored traces as the filter's commands take them: named, scaled, never written over."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.errors import DataError, StorageError, UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.filter import FilterModel
    from hdbench.profile import Profile
    from hdbench.records import TorqueScale, Trace

__all__ = ["Input", "check_out", "read_input", "show_each", "targets", "together"]


@dataclass(frozen=True, slots=True)
class Input:
    """One trace with its torque in N m.

    Parameters
    ----------
    source, file : Path
        What was named, and the trace file it means.
    trace : Trace
        With ``torque_nm``.
    scale : TorqueScale
        The gain that made it.
    """

    source: Path
    file: Path
    trace: Trace
    scale: TorqueScale

    def identity(self) -> dict[str, Any]:
        """Return path and digest of the file, and what it was imported from."""
        from hdbench.records import input_identity

        return input_identity(self.file)


def read_input(
    source: Path,
    profile: Profile,
    *,
    gain: float | None,
    calibration: Path | None,
    model: FilterModel | None = None,
) -> Input:
    """Read a trace and give it its torque in N m."""
    from hdbench.records import read_trace, resolve_input

    file = resolve_input(source)
    trace, scale = _scaled(
        read_trace(file), source, profile, model, gain=gain, calibration=calibration
    )
    return Input(source, file, trace, scale)


def _scaled(
    trace: Trace,
    source: Path,
    profile: Profile,
    model: FilterModel | None,
    *,
    gain: float | None,
    calibration: Path | None,
) -> tuple[Trace, TorqueScale]:
    from hdbench.profile.scaling import rescaled, stored_scale
    from hdbench.records import Quantity, TorqueScale
    from hdbench.records.jsonfile import read_json

    if gain is not None:
        return _by_gain(trace, gain)
    stored = None
    if (source / "run.json").is_file():
        stored = stored_scale(read_json(source / "run.json").get("calibration"), source)
    known = None if model is None else model.torque_gain_nm_per_v
    if stored is None and model is not None and known is not None and "torque_nm" not in trace:
        origin = model.provenance.get("torque_gain_nm_per_v", "not stated")
        stored = TorqueScale(Quantity(known, 0.0), f"filter model {model.name}: {origin}")
    return rescaled(trace, profile, calibration=calibration, stored=stored)


def _by_gain(trace: Trace, gain: float) -> tuple[Trace, TorqueScale]:
    from hdbench.records import Quantity, TorqueScale

    if not 0.0 < abs(gain) < math.inf:
        raise UsageError(
            f"gain {gain!r} N m/V; needed: a finite number other than 0",
            where="--gain",
            fix="give the sensor's torque per volt",
        )
    if "torque_v" not in trace:
        raise DataError(
            "no torque_v column to scale by --gain; found torque_nm only",
            where=trace.source,
            fix="leave --gain out, or import the raw volts as torque_v",
        )
    scale = TorqueScale(Quantity(gain, 0.0), "--gain; its uncertainty not declared")
    return trace.with_columns(torque_nm=trace["torque_v"] * gain), scale


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
    names = [source.resolve().name.removesuffix(".gz").removesuffix(".csv") for source in sources]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise UsageError(
            f"several inputs are named {', '.join(sorted(twice))}",
            where="TRACE|RUN",
            fix="filter them one by one, each to a file of its own",
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(
            f"cannot make the folder: {error.strerror}", where=str(out), fix="check path and rights"
        ) from error
    return [out / f"{name}.csv" for name in names]


def together(bodies: Sequence[dict[str, Any]], out: Path | None) -> dict[str, Any]:
    """Return the results of several inputs as one."""
    header = {key: bodies[0][key] for key in ("schema", "hdbench_version", "profile")}
    files = {} if out is None else {"out": str(out)}
    return {**header, **files, "results": list(bodies)}


def show_each(
    console: Console,
    bodies: Sequence[dict[str, Any]],
    show: Callable[[Console, dict[str, Any]], None],
) -> None:
    """Print several results, each under the name of its input."""
    for body in bodies:
        console.print(body["input"]["path"], markup=False, highlight=False, soft_wrap=True)
        show(console, body)
