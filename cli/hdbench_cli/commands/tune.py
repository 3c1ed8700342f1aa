"""`hdbench tune`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench.errors import UsageError
from hdbench_cli.next_step import after_tune
from hdbench_cli.next_step import line as next_line
from hdbench_cli.options import calibration_option, profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.filter import FilterModel
    from hdbench.filter.tuning import TuningResult, TuningSettings
    from hdbench.profile import Profile
    from hdbench_cli.inputs import Input

__all__ = ["command", "tune_inputs"]

_SLOW = (
    "auto",
    "none",
    "random-walk",
    "integrated-random-walk",
    "ornstein-uhlenbeck",
    "matern-3/2",
    "resonance",
)


def tune_inputs(
    inputs: list[Input], base: FilterModel, settings: TuningSettings, profile: Profile
) -> TuningResult:
    """Tune a model on traces that were read."""
    from hdbench import __version__
    from hdbench.session.filters import tune_traces

    origins = {f"trace {item.file}": f"sha256 {item.identity()['sha256']}" for item in inputs}
    origins["tuned by"] = f"hdbench {__version__}, profile {profile.name} {profile.sha256}"
    return tune_traces(profile, base, [item.trace for item in inputs], origins, settings)


def _with_orders(base: FilterModel, orders: tuple[float, ...]) -> FilterModel:
    """Add ripple blocks; orders below one half belong to the output."""
    from dataclasses import replace

    from hdbench.filter import OscillatorBlock

    blocks = list(base.blocks)
    for order in orders:
        noise = base.blocks[0].process_noise
        blocks.append(OscillatorBlock(order, "misalignment" if order < 0.5 else "ripple", noise))
    try:
        return replace(base, blocks=tuple(blocks))
    except ValueError as error:
        raise UsageError(
            str(error), where="--order", fix="name each order once, and one the model lacks"
        ) from error


def _check_target(out: Path, inputs: list[Input]) -> None:
    from hdbench_cli.inputs import check_out

    for item in inputs:
        check_out(out, item.source, item.file)
    if out.suffix != ".json":
        raise UsageError(
            f"{out} is no .json file", where="--out", fix="name a model file that ends in .json"
        )
    if not out.parent.is_dir():
        raise UsageError(
            f"there is no folder {out.parent}",
            where="--out",
            fix="make it, or name another",
        )
    if out.exists():
        _refuse_other(out)


def _refuse_other(out: Path) -> None:
    """Refuse to write over what is no filter model."""
    from hdbench.errors import DataError
    from hdbench.filter.model import SCHEMA
    from hdbench.records import read_json

    try:
        known = read_json(out).get("schema") == SCHEMA
    except DataError:
        known = False
    if not known:
        raise UsageError(
            f"{out.name} exists and is no filter model", where="--out", fix="name another file"
        )


@click.command("tune", epilog="Example: hdbench tune runs/RUN --out tuned.json")
@click.argument(
    "sources", metavar="TRACE|RUN...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--out",
    metavar="MODEL.json",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="Model file to write.",
)
@profile_option
@click.option(
    "--model",
    "filter_name",
    metavar="NAME|FILE",
    help="Model whose orders are tuned: a preset, a model file, a diagnosis' extended model; "
    "else the profile's.",
)
@click.option(
    "--order",
    "orders",
    metavar="ORDER",
    multiple=True,
    type=click.FloatRange(min=0.0, min_open=True),
    help="Further order, cycles per motor turn; may be repeated.",
)
@click.option(
    "--slow",
    type=click.Choice(_SLOW),
    default="auto",
    show_default=True,
    help="Kind of torque unknown to the expected torque; auto takes the stationary kind that the "
    "likelihood prefers.",
)
@click.option(
    "--gate",
    "gate_sigma",
    metavar="SIGMA",
    type=float,
    default=6.0,
    show_default=True,
    help="Outliers: so many standard deviations of the innovation; 0 keeps all.",
)
@calibration_option
@click.option("--gain", metavar="N·m/V", type=float, help="Gain that scales torque_v.")
@click.pass_obj
def command(
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
    """Fit the filter's noise to traces, so that it takes the ripple and keeps the torque.

    Maximum likelihood of the innovations over one or many traces: process noise of every order,
    slow torque, measurement noise. The result is a model file for --model.
    """
    from dataclasses import replace

    from hdbench.filter import kernel_name, kernel_reason
    from hdbench.filter.tuning import settings_of
    from hdbench.records import result_header, write_json
    from hdbench.session.filters import choose_filter
    from hdbench_cli.commands.experiment import choose_profile
    from hdbench_cli.inputs import read_input

    profile = choose_profile(profile_name, sources[0])
    base = _with_orders(choose_filter(profile, filter_name), orders)
    inputs = [
        read_input(source, profile, gain=gain, calibration=calibration, model=base)
        for source in sources
    ]
    _check_target(out, inputs)
    try:
        settings = replace(
            settings_of(profile.data, slow=slow), gate_sigma=gate_sigma if gate_sigma else None
        )
    except ValueError as error:
        raise UsageError(str(error), where="--gate", fix="give 0, or 4 and more") from error
    if kernel_name() != "c":
        output.note(f"tuning without the compiled kernel takes hours: {kernel_reason()}")
    found = tune_inputs(inputs, base, settings, profile)
    body = {
        **result_header("tune", profile),
        "inputs": [item.identity() for item in inputs],
        "out": str(out),
        "torque_scale": inputs[0].scale.to_dict(),
        **found.to_dict(),
        "filter": found.model.to_dict(),
    }
    write_json(out, found.model.to_dict())
    output.result(body, lambda console: show(console, body))


def show(console: Console, body: dict[str, Any]) -> None:
    """Print a tuning for a person."""
    from rich.table import Table

    table = Table("number", "value", "factor of one std", "unit", box=None, pad_edge=False)
    for item in body["parameters"]:
        log_std = item["log_std"]
        spread = "not determined" if log_std is None else f"{2.718281828459045**log_std:.3g}"
        table.add_row(item["name"], f"{item['estimate']['value']:.4g}", spread, item["unit"])
    console.print(table)
    best = body["slow_candidates"][0]["penalised_nats"]
    for candidate in body["slow_candidates"]:
        starts = candidate["starts"]
        ended = "converged" if any(s["converged"] for s in starts) else "NOT converged"
        text = f"{candidate['penalised_nats'] - best:12.1f} nats  {candidate['slow']}, {ended}, "
        text += f"{candidate['starts_agreed']} of {len(starts)} starts agree"
        text += f"; refused: {candidate['refused']}" if candidate["refused"] else ""
        console.print(text, markup=False, highlight=False, soft_wrap=True)
    nis, white = body["consistency"]["nis"], body["consistency"]["whiteness"]
    lines = [
        f"innovations: NIS {nis['value']:.4f} (95 % {nis['band'][0]:.4f} ... {nis['band'][1]:.4f}),"
        f" Ljung-Box p {white['p_value']:.3g}, largest autocorrelation "
        f"{white['largest_autocorrelation']:+.3f}; {body['outliers']} outliers left out",
        *(f"note: {note}" for note in body["notes"]),
        f"written: {body['out']}",
        next_line(after_tune(Path(body["out"]))),
    ]
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)
