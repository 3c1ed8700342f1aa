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
    from hdbench.records import Quantity, TorqueScale
    from hdbench.records.jsonfile import read_json
    from hdbench.session.scaling import rescaled, stored_scale

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


def _missing(trace: Trace) -> int:
    velocity = "motor_velocity_rad_s" if "motor_velocity_rad_s" in trace else "tacho_v"
    return len(trace) - int(trace.valid("torque_nm", velocity).sum())


def _summary(trace: Trace, block: FilteredBlock, model: FilterModel) -> dict[str, Any]:
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
        "missing_samples": _missing(trace),
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

    Gives the same bits as the filter that ran while the trace was sampled. Exits 6 where samples
    are missing: the file is written, and its torque is nan there.
    """
    from hdbench.filter import filter_trace, filtered_columns, load_filter_model
    from hdbench.records import read_trace, resolve_input, result_header, sha256_file, write_trace

    if gain is not None and calibration is not None:
        raise click.UsageError("--gain and --calibration both name a gain; give one")
    profile = choose_profile(profile_name, source)
    model = load_filter_model(filter_name or profile.data.filter.model, profile.data)
    file = resolve_input(source)
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
        **_summary(trace, block, model),
    }
    write_trace(out, filtered_columns(trace, block))
    output.result(body, lambda console: _show(console, body))
    if body["missing_samples"]:
        doubt = DoubtfulDataError(
            f"{body['missing_samples']} of {body['samples']} samples lack torque or velocity; "
            "the filter only predicted there",
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
