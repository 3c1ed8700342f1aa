"""`hdbench demo`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.options import seed_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.profile import Profile

__all__ = ["command"]

_PROFILE = "cim-tr-97-06"
_KINDS = ("calibration", "misalignment", "ripple")


def _runs(output: Output, profile: Profile, out: Path, plant: str, seed: int) -> dict[str, Any]:
    from hdbench.session import BenchOptions, run_experiment
    from hdbench_cli.live.progress import progress_bar

    done: dict[str, Any] = {}
    for kind in _KINDS:
        options = BenchOptions(
            out=out,
            plant=plant,
            seed=seed,
            calibration=done["calibration"].folder.path if kind != "calibration" else None,
            misalignment=done["misalignment"].folder.path if kind == "ripple" else None,
        )
        with progress_bar(kind) as progress:
            done[kind] = run_experiment(kind, profile, options, progress)
        output.note(f"  {kind} done: {done[kind].folder.path}")
    return done


def _hidden_words(effect: Mapping[str, Any]) -> str:
    """Return a hidden effect in one line."""
    numbers = [
        f"{name} {value:.4g}"
        for name, value in effect.items()
        if isinstance(value, int | float) and not name.startswith("phase")
    ]
    return f"{effect['kind']}: {', '.join(numbers)}"


def _again(profile: Profile, trace_run: Path, model_file: Path) -> str:
    """Return the verdict on a record that the extended model simulates."""
    import numpy as np

    from hdbench.diagnosis import diagnose_trace
    from hdbench.model import load_model, simulate_like, with_noise
    from hdbench.records import read_trace, resolve_input

    model = load_model(model_file)
    simulated = simulate_like(read_trace(resolve_input(trace_run)), profile.data, model)
    noisy = with_noise(simulated, profile.data.sensor.noise_nm, np.random.default_rng(0))
    return diagnose_trace(noisy, profile, model=model).verdict


def _draw(console: Console, results: Mapping[str, Mapping[str, Any]]) -> None:
    from hdbench_cli.commands import calibrate, run_misalignment, run_ripple

    shows = {
        "calibration": calibrate.summary,
        "misalignment": run_misalignment.show,
        "ripple": run_ripple.show,
    }
    for kind, show in shows.items():
        console.rule(f"[bold]{kind}[/]", align="left")
        show(console, results[kind])


@click.command("demo", epilog="Example: hdbench demo --seed 3")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    default=Path("runs"),
    show_default=True,
    help="Parent folder of run folders.",
)
@click.option(
    "--plant",
    metavar="NAME|FILE",
    default="worn",
    show_default=True,
    help="What the embedded bench has beyond its model.",
)
@seed_option
@click.pass_obj
def command(output: Output, out: Path, plant: str, seed: int) -> None:
    """Run the whole bench in about a minute, without hardware.

    Calibrate, measure misalignment and ripple, let the diagnosis find what the plant hides, and
    write one report.
    """
    from hdbench.devices.simulation import hidden_effects
    from hdbench.diagnosis import diagnose_run
    from hdbench.profile import load_profile
    from hdbench.records import result_header
    from hdbench.report import write_report
    from hdbench_cli.commands import diagnosis_text
    from hdbench_cli.live.progress import progress_bar

    started = time.monotonic()
    profile = load_profile(_PROFILE)
    output.note(f"embedded bench {_PROFILE}, plant {plant}, seed {seed}")
    done = _runs(output, profile, out, plant, seed)
    with progress_bar("diagnose") as progress:
        folder, found = diagnose_run(
            done["ripple"].folder.path, profile, out=out, progress=progress
        )
    output.note(f"  diagnosis done: {folder}")
    folders = [done[kind].folder.path for kind in _KINDS] + [folder]
    with progress_bar("simulate") as progress:
        progress("the extended model, diagnosed again", 0.5)
        again = _again(profile, done["ripple"].folder.path, folder / "model.json")
    hidden = hidden_effects(profile, plant, seed)
    report = folder / "report.html"
    write_report(folders, report, profile=profile)
    results = {kind: done[kind].evaluation.result.to_json() for kind in _KINDS}
    seconds = time.monotonic() - started

    def text(console: Console) -> None:
        _draw(console, results)
        console.rule("[bold]diagnosis[/]", align="left")
        diagnosis_text.show(console, found, folder)
        console.rule("[bold]what the plant had hidden[/]", align="left")
        for effect in hidden:
            console.print(_hidden_words(effect), markup=False)
        console.print(f"the extended model, simulated and diagnosed again: {again}")
        console.print(f"\n{seconds:.0f} s. Open the report:")
        console.print(str(report), style="bold", soft_wrap=True)

    body = {
        **result_header("demo", profile),
        "seconds": seconds,
        "results": {**results, "diagnosis": found},
        "hidden": [dict(effect) for effect in hidden],
        "extended_model_verdict": again,
        "runs": [str(path) for path in folders],
        "report": str(report),
    }
    output.result(body, text)
