"""`hdbench tune`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hdbench import __version__
from hdbench.errors import DataError, UsageError
from hdbench.filter import FilterModel, OscillatorBlock, kernel_name, kernel_reason
from hdbench.filter.model import SCHEMA
from hdbench.filter.presets import choose_filter
from hdbench.filter.tuning.problem import TuningSettings
from hdbench.filter.tuning.result import TuningResult
from hdbench.filter.tuning.run import settings_of, tune_traces
from hdbench.profile import Profile
from hdbench.records import read_json, write_json
from hdbench.results.parts import first_fault
from hdbench_cli.inputs import Input, check_out, choose_profile, read_input
from hdbench_cli.next_step import after_tune, next_line
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, table


def tune_inputs(
    inputs: list[Input], base: FilterModel, settings: TuningSettings, profile: Profile
) -> TuningResult:
    """Tune a model on traces that were read."""
    origins = {f"trace {item.file}": f"sha256 {item.identity()['sha256']}" for item in inputs}
    origins["tuned by"] = f"hdbench {__version__}, profile {profile.name} {profile.sha256}"
    return tune_traces(profile, base, [item.trace for item in inputs], origins, settings)


def tuned_on(item: Input, profile: Profile) -> FilterModel:
    """Tune the profile's orders on this very trace."""
    base = choose_filter(profile, None)
    return tune_inputs([item], base, settings_of(profile.data), profile).model


def _with_orders(base: FilterModel, orders: tuple[float, ...]) -> FilterModel:
    """Add ripple blocks; orders below one half belong to the output."""
    noise = base.blocks[0].process_noise
    added = (
        OscillatorBlock(order, "misalignment" if order < 0.5 else "ripple", noise)
        for order in orders
    )
    try:
        return replace(base, blocks=(*base.blocks, *added))
    except ValidationError as error:
        raise UsageError(
            first_fault(error)[1],
            where="--order",
            fix="name each order once, and one the model lacks",
        ) from error


def _check_target(out: Path, inputs: list[Input]) -> None:
    for item in inputs:
        check_out(out, item.source, item.file)
    if out.suffix != ".json":
        what, fix = f"{out} is no .json file", "name a model file that ends in .json"
    elif not out.parent.is_dir():
        what, fix = f"there is no folder {out.parent}", "make it, or name another"
    elif out.exists() and not _is_model(out):
        what, fix = f"{out.name} exists and is no filter model", "name another file"
    else:
        return
    raise UsageError(what, where="--out", fix=fix)


def _is_model(file: Path) -> bool:
    try:
        return bool(read_json(file).get("schema") == SCHEMA)
    except DataError:
        return False


def tune_command(
    output: Output,
    sources: tuple[Path, ...],
    out: Path,
    profile_name: str | None,
    filter_name: str | None,
    orders: tuple[float, ...],
    slow: Any,
    gate_sigma: float,
    calibration: Path | None,
    gain: float | None,
) -> None:
    """Fit the noise parameters of the filter to traces."""
    profile = choose_profile(profile_name, sources[0])
    base = _with_orders(choose_filter(profile, filter_name), orders)
    inputs = [
        read_input(source, profile, gain=gain, calibration=calibration, model=base)
        for source in sources
    ]
    _check_target(out, inputs)
    try:
        settings = replace(settings_of(profile.data, slow=slow), gate_sigma=gate_sigma or None)
    except ValueError as error:
        what = f"a gate of {gate_sigma:g} cuts into the noise"
        raise UsageError(what, where="--gate", fix="give 0, or 4 and more") from error
    if kernel_name() != "c":
        output.note(f"tuning without the compiled kernel takes hours: {kernel_reason()}")
    found = tune_inputs(inputs, base, settings, profile)
    body = {
        "inputs": [item.identity() for item in inputs],
        "out": str(out),
        "torque_scale": inputs[0].scale.to_dict(),
        **found.to_dict(),
        "filter": found.model.to_dict(),
    }
    write_json(out, found.model.to_dict())
    output.result(body, _lines(body), kind="tune", profile=profile)


def _lines(body: Mapping[str, Any]) -> Lines:
    rows = []
    for item in body["parameters"]:
        log_std = item["log_std"]
        spread = "not determined" if log_std is None else f"{math.exp(log_std):.3g}"
        rows.append((item["name"], f"{item['estimate']['value']:.4g}", spread, item["unit"]))
    yield table(("number", "value", "factor of one std", "unit"), rows)
    best = body["slow_candidates"][0]["penalised_nats"]
    for candidate in body["slow_candidates"]:
        starts = candidate["starts"]
        ended = "converged" if any(s["converged"] for s in starts) else "NOT converged"
        refused = f"; refused: {candidate['refused']}" if candidate["refused"] else ""
        yield (
            f"{candidate['penalised_nats'] - best:12.1f} nats  {candidate['slow']}, {ended}, "
            f"{candidate['starts_agreed']} of {len(starts)} starts agree{refused}"
        )
    nis, white = body["consistency"]["nis"], body["consistency"]["whiteness"]
    yield (
        f"innovations: NIS {nis['value']:.4f} (95 % {nis['band'][0]:.4f} ... {nis['band'][1]:.4f}),"
        f" Ljung-Box p {white['p_value']:.3g}, largest autocorrelation "
        f"{white['largest_autocorrelation']:+.3f}; {body['outliers']} outliers left out"
    )
    yield from (f"note: {note}" for note in body["notes"])
    yield f"written: {body['out']}"
    yield next_line(after_tune(Path(body["out"])))
