"""`hdbench filter`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench.errors import DataError, DoubtfulDataError, UsageError
from hdbench_cli.experiment import choose_profile
from hdbench_cli.options import calibration_option, model_option, profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.estimation import DataFlag
    from hdbench.filter import FilteredBlock, FilterModel
    from hdbench.profile import Profile
    from hdbench.records import TorqueScale, Trace

__all__ = ["command"]


def _scaled(
    trace: Trace,
    source: Path,
    profile: Profile,
    model: FilterModel,
    gain: float | None,
    calibration: Path | None,
) -> tuple[Trace, TorqueScale]:
    """Give the trace its torque in N m: the named gain, else what is known of it, in that order."""
    from hdbench.profile.scaling import rescaled, stored_scale
    from hdbench.records import Quantity, TorqueScale
    from hdbench.records.jsonfile import read_json

    if gain is not None:
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
    stored = None
    if (source / "run.json").is_file():
        stored = stored_scale(read_json(source / "run.json").get("calibration"), source)
    if stored is None and model.torque_gain_nm_per_v is not None and "torque_nm" not in trace:
        origin = model.provenance.get("torque_gain_nm_per_v", "not stated")
        stored = TorqueScale(
            Quantity(model.torque_gain_nm_per_v, 0.0), f"filter model {model.name}: {origin}"
        )
    return rescaled(trace, profile, calibration=calibration, stored=stored)


def _check_out(out: Path, source: Path, file: Path) -> None:
    """Refuse to write over what was measured."""
    if out.resolve() == file.resolve() or (
        source.is_dir() and out.resolve().parent == source.resolve()
    ):
        raise UsageError(
            f"{out} belongs to the measured data; needed: another file",
            where="--out",
            fix="name a new file outside the run",
        )


def _lost(trace: Trace, profile: Profile) -> int:
    """Return how many samples have a torque or velocity that the filter cannot use."""
    import numpy as np

    from hdbench.filter.layout import USABLE

    velocity = (
        trace["motor_velocity_rad_s"]
        if "motor_velocity_rad_s" in trace
        else trace["tacho_v"] * profile.data.tacho.gain_rad_s_per_v
    )
    usable = (np.abs(velocity) <= USABLE) & (np.abs(trace["torque_nm"]) <= USABLE)
    return len(trace) - int(np.count_nonzero(usable))


def _flags(trace: Trace, profile: Profile) -> list[DataFlag]:
    """Return what makes the filtered trace doubtful: lost samples, gaps in time, saturation."""
    from hdbench.estimation import DataFlag, data_flags

    others = data_flags(trace, trace["torque_nm"], profile.data)
    flags = [flag for flag in others if flag.name != "missing-samples"]
    lost = _lost(trace, profile)
    if lost:
        words = f"{lost} of {len(trace)} samples lack torque or velocity"
        detail = f"{words}; the filter only predicted there"
        flags.insert(0, DataFlag("missing-samples", lost, detail))
    return flags


def _summary(
    trace: Trace, block: FilteredBlock, model: FilterModel, flags: list[DataFlag]
) -> dict[str, Any]:
    import numpy as np

    from hdbench.filter import kernel_name

    both = np.isfinite(trace["torque_nm"]) & np.isfinite(block.torque_filtered_nm)
    if not both.any():
        raise DataError(
            "no sample has a torque", where=trace.source, fix="record the torque channel"
        )

    def rms(values: Any) -> float:
        return float(np.sqrt(np.mean(np.square(values[both]))))

    return {
        "samples": len(trace),
        "missing_samples": sum(f.samples for f in flags if f.name == "missing-samples"),
        "flags": [flag.to_dict() for flag in flags],
        "torque_rms_nm": {
            "measured": rms(trace["torque_nm"]),
            "filtered": rms(block.torque_filtered_nm),
        },
        "kernel": kernel_name(),
        "filter": model.to_dict(),
    }


@click.command("filter", epilog="Example: hdbench filter runs/RUN --model report-6 --out clean.csv")
@click.argument("source", metavar="TRACE|RUN", type=click.Path(path_type=Path))
@model_option
@profile_option
@calibration_option
@click.option(
    "--gain",
    metavar="N·m/V",
    type=float,
    help="Gain that scales torque_v; else that of calibration, run, model or profile.",
)
@click.option(
    "--out",
    metavar="FILE.csv",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="Trace file to write (.csv or .csv.gz).",
)
@click.pass_obj
def command(
    output: Output,
    source: Path,
    filter_name: str | None,
    profile_name: str | None,
    calibration: Path | None,
    gain: float | None,
    out: Path,
) -> None:
    """Take ripple and misalignment out of a stored trace.

    A run is filtered by the filter that ran in it and gives the same bits, unless --model or
    another profile says otherwise. Exits 6 where samples are missing, saturated or apart: the
    file is written, and its torque is nan where it is missing.
    """
    from hdbench.filter import filter_trace, filtered_columns
    from hdbench.records import read_trace, resolve_input, result_header, sha256_file, write_trace
    from hdbench.session.filters import choose_filter

    if gain is not None and calibration is not None:
        raise click.UsageError("--gain and --calibration both name a gain; give one")
    profile = choose_profile(profile_name, source)
    model = choose_filter(profile, filter_name, source=source)
    file = resolve_input(source)
    _check_out(out, source, file)
    trace, scale = _scaled(read_trace(file), source, profile, model, gain, calibration)
    block = filter_trace(
        trace,
        model,
        velocity_gain_rad_s_per_v=profile.data.tacho.gain_rad_s_per_v,
        encoder_counts_per_turn=profile.data.encoder.counts_per_turn,
    )
    body = {
        **result_header("filter", profile),
        "input": {"path": str(file), "sha256": sha256_file(file)},
        "out": str(out),
        "torque_scale": scale.to_dict(),
        **_summary(trace, block, model, _flags(trace, profile)),
    }
    write_trace(out, filtered_columns(trace, block))
    output.result(body, lambda console: _show(console, body))
    if body["flags"]:
        doubt = DoubtfulDataError(
            "; ".join(flag["detail"] for flag in body["flags"]),
            where=str(file),
            fix="look at the marked samples, then measure again",
        )
        if output.json:
            output.note(str(doubt))
            raise click.exceptions.Exit(doubt.exit_code)
        raise doubt


def _show(console: Console, body: dict[str, Any]) -> None:
    rms, model = body["torque_rms_nm"], body["filter"]
    orders = ", ".join(f"{block['order']:g}" for block in model["blocks"])
    for name, text in (
        ("model", f"{model['name']}, orders {orders}, kernel {body['kernel']}"),
        ("torque gain", body["torque_scale"]["source"]),
        ("torque rms", f"{rms['measured']:.4f} measured, {rms['filtered']:.4f} filtered N m"),
        ("written", f"{body['out']}, {body['samples']} samples"),
    ):
        console.print(f"{name:12s}{text}", markup=False, highlight=False, soft_wrap=True)
