"""One stored trace through the filter: what `hdbench filter` does for each of its inputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.errors import DataError
from hdbench_cli.commands.experiment import choose_profile

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.filter import FilteredBlock, FilterModel
    from hdbench.profile import Profile
    from hdbench.records import Trace
    from hdbench.results import DataFlag
    from hdbench_cli.inputs import Input

__all__ = ["Request", "filter_input", "show_filtered"]


@dataclass(frozen=True, slots=True)
class Request:
    """What is asked of every input.

    Parameters
    ----------
    filter_name, profile_name : str or None
        As on the command line.
    calibration : Path or None
        Calibration whose gain scales the torque.
    gain : float or None
        Gain that scales it, N m/V.
    smooth, compare : bool
        Whether to add the smoother's columns, and the comparison's.
    plot : Path or None
        Picture of the comparison.
    """

    filter_name: str | None
    profile_name: str | None
    calibration: Path | None
    gain: float | None
    smooth: bool
    compare: bool
    plot: Path | None


def _lost(trace: Trace, profile: Profile) -> int:
    """Return how many samples have a torque or velocity that the filter cannot use."""
    import numpy as np

    from hdbench.filter.kalman import USABLE

    velocity = (
        trace["motor_velocity_rad_s"]
        if "motor_velocity_rad_s" in trace
        else trace["tacho_v"] * profile.data.tacho.gain_rad_s_per_v
    )
    usable = (np.abs(velocity) <= USABLE) & (np.abs(trace["torque_nm"]) <= USABLE)
    return len(trace) - int(np.count_nonzero(usable))


def _flags(trace: Trace, source: Path, profile: Profile, block: FilteredBlock) -> list[DataFlag]:
    """Return what makes the filtered trace doubtful.

    Lost, saturated and stuck samples, gaps; of a file also channels in another unit or in each
    other's place.
    """
    import numpy as np

    from hdbench.estimation import data_flags
    from hdbench.filter.online import FLAG_BITS
    from hdbench.results import DataFlag
    from hdbench.session.doubts import channel_refusal

    others = data_flags(trace, trace["torque_nm"], profile.data)
    flags = [flag for flag in others if flag.name != "missing-samples"]
    lost = _lost(trace, profile)
    if lost:
        words = f"{lost} of {len(trace)} samples lack torque or velocity"
        detail = f"{words}; the filter only predicted there"
        flags.insert(0, DataFlag("missing-samples", lost, detail))
    known = {flag.name for flag in flags}
    for name, bit in (("saturation", FLAG_BITS["saturated"]), ("stuck", FLAG_BITS["stuck"])):
        count = int(np.count_nonzero(block.flags & bit))
        if count and name not in known:
            detail = f"{name}: {count} of {len(trace)} samples; the filter only predicted there"
            flags.append(DataFlag(name, count, detail))
    refusal = channel_refusal(trace, source, profile)
    return [*flags, DataFlag("wrong-channel", len(trace), refusal)] if refusal else flags


def _summary(
    trace: Trace, block: FilteredBlock, model: FilterModel, flags: list[DataFlag]
) -> dict[str, Any]:
    import numpy as np

    from hdbench.filter import kernel_name
    from hdbench.filter.online import FLAG_BITS

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
        "flags": [flag.to_json() for flag in flags],
        "sample_flags": {
            name: int(np.count_nonzero(block.flags & bit)) for name, bit in FLAG_BITS.items()
        },
        "torque_rms_nm": {
            "measured": rms(trace["torque_nm"]),
            "filtered": rms(block.torque_filtered_nm),
        },
        "kernel": kernel_name(),
        "filter": model.to_dict(),
    }


def _tuned(item: Input, profile: Profile) -> FilterModel:
    """Tune the profile's orders on this very trace."""
    from hdbench.filter.tuning import settings_of
    from hdbench.session.filters import choose_filter
    from hdbench_cli.commands.tune import tune_inputs

    base = choose_filter(profile, None)
    return tune_inputs([item], base, settings_of(profile.data), profile).model


def _smoothed(
    written: Trace, trace: Trace, model: FilterModel, profile: Profile
) -> tuple[Trace, list[dict[str, Any]]]:
    from hdbench.filter.smoothing import smooth_channels
    from hdbench.session.filters import trace_channels
    from hdbench_cli.commands.filter_output import smoothed_columns, smoothed_summary

    smoothed = smooth_channels(
        model, trace_channels(trace, profile, use_measured_angle=model.use_measured_angle)
    )
    return smoothed_columns(written, smoothed), smoothed_summary(smoothed)


def _compared(
    written: Trace, item: Input, model: FilterModel, profile: Profile, plot: Path | None
) -> tuple[Trace, dict[str, Any]]:
    """Compare with the model at hand where it is a tuned one, else with one tuned here."""
    from hdbench_cli.commands.filter_output import compare, compared_columns, draw_comparison

    tuned = model if model.tuning is not None else _tuned(item, profile)
    found = compare(item.trace, tuned, profile)
    if plot is not None:
        draw_comparison(plot, item.trace, found)
    return compared_columns(written, found), found.to_dict()


def filter_input(request: Request, source: Path, out: Path) -> dict[str, Any]:
    """Filter one stored trace and write the result."""
    from hdbench.filter import filter_trace, filtered_columns
    from hdbench.records import result_header, write_trace
    from hdbench.session.filters import choose_filter
    from hdbench_cli.inputs import check_out, read_input

    profile = choose_profile(request.profile_name, source)
    tuned = request.filter_name == "tuned"
    model = choose_filter(profile, None if tuned else request.filter_name, source=source)
    item = read_input(
        source, profile, gain=request.gain, calibration=request.calibration, model=model
    )
    check_out(out, source, item.file)
    trace = item.trace
    if tuned:
        model = _tuned(item, profile)
    block = filter_trace(
        trace,
        model,
        velocity_gain_rad_s_per_v=profile.data.tacho.gain_rad_s_per_v,
        encoder_counts_per_turn=profile.data.encoder.counts_per_turn,
    )
    body = {
        **result_header("filter", profile),
        "input": item.identity(),
        "out": str(out),
        "torque_scale": item.scale.to_dict(),
        **_summary(trace, block, model, _flags(trace, source, profile, block)),
    }
    written = filtered_columns(trace, block)
    if request.smooth:
        written, body["orders"] = _smoothed(written, trace, model, profile)
    if request.compare:
        written, body["comparison"] = _compared(written, item, model, profile, request.plot)
    write_trace(out, written)
    return body


def show_filtered(console: Console, body: dict[str, Any]) -> None:
    """Print one result for a person."""
    rms, model = body["torque_rms_nm"], body["filter"]
    places = [
        f"{block['frequency_hz']:g} Hz" if "frequency_hz" in block else f"{block['order']:g}"
        for block in model["blocks"]
    ]
    orders = ", ".join(places)
    for name, text in (
        ("model", f"{model['name']}, orders {orders}, kernel {body['kernel']}"),
        ("torque gain", body["torque_scale"]["source"]),
        ("torque rms", f"{rms['measured']:.4f} measured, {rms['filtered']:.4f} filtered N m"),
        ("written", f"{body['out']}, {body['samples']} samples"),
    ):
        console.print(f"{name:12s}{text}", markup=False, highlight=False, soft_wrap=True)
    if "orders" in body:
        from hdbench_cli.commands.filter_output import show_orders

        show_orders(console, body["orders"])
    if "comparison" in body:
        from hdbench_cli.commands.filter_output import show_comparison

        show_comparison(console, body["comparison"])
