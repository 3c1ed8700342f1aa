"""`hdbench demo`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.devices.operator import hidden_effects
from hdbench.diagnosis import Diagnosis, diagnose_run, diagnose_trace
from hdbench.model import load_model, simulate_like, with_noise
from hdbench.profile import Profile
from hdbench.records import read_trace, resolve_input
from hdbench.session import BenchOptions, run_experiment
from hdbench_cli.commands import diagnosis_text
from hdbench_cli.commands.experiment_text import LINES, calibration_summary
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output, progress_bar
from hdbench_cli.text import Lines, styled

_KINDS = ("calibration", "misalignment", "ripple")


def _runs(output: Output, profile: Profile, out: Path, plant: str, seed: int) -> dict[str, Any]:
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


def _hidden_line(effect: Mapping[str, Any]) -> str:
    """Return a hidden effect in one line."""
    numbers = [
        f"{name} {value:.4g}"
        for name, value in effect.items()
        if isinstance(value, int | float) and not name.startswith("phase")
    ]
    return f"{effect['kind']}: {', '.join(numbers)}"


def _again(profile: Profile, trace_run: Path, model_file: Path) -> str:
    """Return the verdict on a record that the extended model simulates."""
    model = load_model(model_file)
    simulated = simulate_like(read_trace(resolve_input(trace_run)), profile.data, model)
    noisy = with_noise(simulated, profile.data.sensor.noise_nm, np.random.default_rng(0))
    return diagnose_trace(noisy, profile, model=model).verdict


def _lines(body: Mapping[str, Any], found: Diagnosis) -> Lines:
    from rich.rule import Rule

    for kind, lines in {**LINES, "calibration": calibration_summary}.items():
        yield Rule(styled((kind, "bold")), align="left")
        yield from lines(body["results"][kind])
    yield Rule(styled(("diagnosis", "bold")), align="left")
    yield from diagnosis_text.lines(found, Path(body["runs"][-1]))
    yield Rule(styled(("what the plant had hidden", "bold")), align="left")
    yield from map(_hidden_line, body["hidden"])
    verdict = body["extended_model_verdict"]
    yield f"the extended model, simulated and diagnosed again: {verdict}"
    yield f"\n{body['seconds']:.0f} s. Open the report:"
    yield styled((body["report"], "bold"))


def demo_command(output: Output, out: Path, plant: str, seed: int) -> None:
    """Run the whole bench in about a minute, without hardware."""
    from hdbench.report import write_report

    started = time.monotonic()
    profile = choose_profile(None, None)
    output.note(f"embedded bench {profile.name}, plant {plant}, seed {seed}")
    done = _runs(output, profile, out, plant, seed)
    ripple = done["ripple"].folder.path
    with progress_bar("diagnose") as progress:
        folder, found = diagnose_run(ripple, profile, out=out, progress=progress)
    output.note(f"  diagnosis done: {folder}")
    folders = [done[kind].folder.path for kind in _KINDS] + [folder]
    with progress_bar("simulate") as progress:
        progress("the extended model, diagnosed again", 0.5)
        again = _again(profile, ripple, folder / "model.json")
    hidden = hidden_effects(profile, plant, seed)
    report = folder / "report.html"
    write_report(folders, report, profile=profile)
    results = {kind: done[kind].result.to_json() for kind in _KINDS}
    body = {
        "seconds": time.monotonic() - started,
        "results": {**results, "diagnosis": found.to_json()},
        "hidden": [dict(effect) for effect in hidden],
        "extended_model_verdict": again,
        "runs": [str(path) for path in folders],
        "report": str(report),
    }
    output.result(body, _lines(body, found), kind="demo", profile=profile)
