"""`hdbench filter`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError, DoubtfulDataError
from hdbench.estimation.stretches import data_flags
from hdbench.filter import (
    FilteredBlock,
    FilterModel,
    filter_channels,
    filter_trace,
    filtered_columns,
    kernel_name,
    preset,
)
from hdbench.filter.comparison import Comparison, compare_filters
from hdbench.filter.online import FLAG_BITS
from hdbench.filter.orders import SmoothedTorque, smooth_channels
from hdbench.filter.presets import choose_filter
from hdbench.profile import Profile
from hdbench.records import Trace, result_header, write_trace
from hdbench.results import DataFlag
from hdbench.session.evaluation import channel_refusal
from hdbench_cli.commands.tune import tuned_on
from hdbench_cli.inputs import check_out, choose_profile, read_input, show_results, targets
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, table

# column of a simulated trace with the true torque, N m
_TRUTH = "torque_true_nm"


def filter_command(output: Output, /, sources: tuple[Path, ...], out: Path, **options: Any) -> None:
    """Remove ripple and misalignment from stored traces."""
    files = targets(out, sources)
    bodies = [_filtered(*pair, **options) for pair in zip(sources, files, strict=True)]
    show_results(output, bodies, out, _lines)
    output.end(_doubt([body for body in bodies if body["flags"]]))


def _filtered(
    source: Path,
    out: Path,
    *,
    filter_name: str | None,
    profile_name: str | None,
    smooth: bool,
    compare: bool,
    plot: Path | None,
    **scaling: Any,
) -> dict[str, Any]:
    """Filter one stored trace and write the result."""
    profile = choose_profile(profile_name, source)
    tuned = filter_name == "tuned"
    model = choose_filter(profile, None if tuned else filter_name, source=source)
    item = read_input(source, profile, model=model, **scaling)
    check_out(out, source, item.file)
    trace = item.trace
    if tuned:
        model = tuned_on(item, profile)
    block = filter_trace(trace, model, profile.data)
    body = {
        **result_header("filter", profile),
        "input": item.identity(),
        "out": str(out),
        "torque_scale": item.scale.to_dict(),
        **_summary(trace, block, model, _flags(trace, source, profile, block)),
    }
    written = filtered_columns(trace, block)
    if smooth:
        channels = filter_channels(trace, profile.data, use_measured_angle=model.use_measured_angle)
        smoothed = smooth_channels(model, channels)
        written, body["orders"] = smoothed_columns(written, smoothed), smoothed_summary(smoothed)
    if compare:
        # with the model at hand where it is a tuned one, else with one tuned here
        best = model if model.tuning is not None else tuned_on(item, profile)
        found = _compared(trace, best, profile)
        if plot is not None:
            _draw(plot, trace, found)
        others = {name: torque for name, torque in found.torque_nm.items() if name != "raw"}
        written = written.with_columns(**{f"torque_{name}_nm": x for name, x in others.items()})
        body["comparison"] = found.to_dict()
    write_trace(out, written)
    return body


def _flags(trace: Trace, source: Path, profile: Profile, block: FilteredBlock) -> list[DataFlag]:
    """Return what makes the filtered trace doubtful.

    Lost, saturated and stuck samples, gaps; of a file also channels in another unit or in each
    other's place.
    """
    others = data_flags(trace, trace["torque_nm"], profile.data)
    flags = [flag for flag in others if flag.name != "missing-samples"]
    predicted = f"of {len(trace)} samples{{}}; the filter only predicted there"
    channels = filter_channels(trace, profile.data, use_measured_angle=False)
    lost = int(np.count_nonzero(~channels.usable))
    if lost:
        detail = f"{lost} {predicted.format(' lack torque or velocity')}"
        flags.insert(0, DataFlag("missing-samples", lost, detail))
    known = {flag.name for flag in flags}
    for name, bit in (("saturation", FLAG_BITS["saturated"]), ("stuck", FLAG_BITS["stuck"])):
        count = int(np.count_nonzero(block.flags & bit))
        if count and name not in known:
            flags.append(DataFlag(name, count, f"{name}: {count} {predicted.format('')}"))
    refusal = channel_refusal(trace, source, profile)
    return [*flags, DataFlag("wrong-channel", len(trace), refusal)] if refusal else flags


def _summary(
    trace: Trace, block: FilteredBlock, model: FilterModel, flags: list[DataFlag]
) -> dict[str, Any]:

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


def _doubt(doubtful: list[dict[str, Any]]) -> DoubtfulDataError | None:
    """Return the error of doubtful inputs; None where there is none."""
    if not doubtful:
        return None
    flags = [flag for body in doubtful for flag in body["flags"]]
    fix = "look at the marked samples, then measure again"
    if any(flag["name"] == "wrong-channel" for flag in flags):
        fix = "bring the file in with the right columns and units: hdbench import --map"
    return DoubtfulDataError(
        "; ".join(flag["detail"] for flag in flags),
        where=", ".join(body["input"]["path"] for body in doubtful),
        fix=fix,
    )


def smoothed_columns(trace: Trace, smoothed: SmoothedTorque) -> Trace:
    """Add the smoothed torque, and every order's amplitude and phase with their bands."""
    names = ("torque_smoothed_nm", "slow_nm", "slow_std_nm")
    columns = {name: getattr(smoothed, name) for name in names}
    parts = ("amplitude_nm", "amplitude_std_nm", "phase_rad", "phase_std_rad")
    for wave in smoothed.waves:
        columns |= {f"{wave.name}_{part}": getattr(wave, part) for part in parts}
    return trace.with_columns(**columns)


def smoothed_summary(smoothed: SmoothedTorque) -> list[dict[str, Any]]:
    """Return every order's amplitude over the trace: mean, least, most, and its mean band."""
    rows = []
    for wave in smoothed.waves:
        known = wave.amplitude_nm[np.isfinite(wave.amplitude_nm)]
        band = wave.amplitude_std_nm[np.isfinite(wave.amplitude_std_nm)]
        rows.append(
            {
                "name": wave.name,
                "role": wave.role,
                "order": wave.order,
                "frequency_hz": wave.frequency_hz,
                "amplitude_nm": {
                    "mean": float(np.mean(known)),
                    "min": float(np.min(known)),
                    "max": float(np.max(known)),
                    "mean_std": float(np.mean(band)),
                },
            }
        )
    return rows


def _compared(trace: Trace, tuned: FilterModel, profile: Profile) -> Comparison:
    """Run raw, low-pass, the report's tuning, the tuned model and its smoother side by side."""
    settings = profile.data.filter
    return compare_filters(
        filter_channels(trace, profile.data, use_measured_angle=True),
        {"report": preset("report-6", profile.data)},
        tuned,
        truth_nm=trace.columns.get(_TRUTH),
        lowpass=(settings.butterworth_cutoff_hz, settings.butterworth_order),
    )


def _draw(path: Path, trace: Trace, comparison: Comparison) -> None:
    """Draw the contenders over time."""
    from hdbench.report.plots import plot_comparison

    torques = dict(comparison.torque_nm)
    if _TRUTH in trace:
        torques = {"truth": trace[_TRUTH], **torques}
    plot_comparison(path, trace.time_s, torques)


def _lines(body: Mapping[str, Any]) -> Lines:
    rms, model = body["torque_rms_nm"], body["filter"]
    orders = ", ".join(
        f"{block['frequency_hz']:g} Hz" if "frequency_hz" in block else f"{block['order']:g}"
        for block in model["blocks"]
    )
    yield f"{'model':12s}{model['name']}, orders {orders}, kernel {body['kernel']}"
    yield f"{'torque gain':12s}{body['torque_scale']['source']}"
    yield f"{'torque rms':12s}{rms['measured']:.4f} measured, {rms['filtered']:.4f} filtered N m"
    yield f"{'written':12s}{body['out']}, {body['samples']} samples"
    yield from order_lines(body.get("orders", ()))
    if "comparison" in body:
        yield from _comparison(body["comparison"])


def order_lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield every order's amplitude."""
    for row in rows:
        a = row["amplitude_nm"]
        band = f"{a['mean']:.4f} N m +- {a['mean_std']:.4f}"
        yield f"{row['name']:<14}{band}, {a['min']:.4f} ... {a['max']:.4f}"


def _comparison(body: Mapping[str, Any]) -> Lines:
    places = list(body["rows"][0]["suppression_db"])
    rows = []
    for row in body["rows"]:
        kept, delay = row["torque_kept"], row["delay_s"]
        taken = [row["suppression_db"][place] for place in places]
        rows.append(
            (
                row["name"],
                *("" if x is None else f"{x:.1f}" for x in taken),
                "" if kept is None else f"{kept:.3f}",
                "" if delay is None else f"{1e3 * delay:+.1f}",
                f"{row['noise_nm']:.4f}",
                f"{row['error_rms_nm']:.4f}",
            )
        )
    numbers = ("torque kept", "delay ms", "noise N m", "error N m")
    yield table(("", *(f"{place} dB" for place in places), *numbers), rows)
    against = "the trace's true torque" if body["reference"] == "truth" else "the smoothed torque"
    yield f"judged from {body['from_s']:.3g} s on against {against}"
