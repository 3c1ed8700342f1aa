"""`hdbench simulate`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DoubtfulDataError, UsageError
from hdbench.model import load_model, simulate_like, simulate_run, with_noise
from hdbench.model.bench import BenchModel
from hdbench.records import Trace, read_trace, resolve_input, write_trace
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output


def simulate_command(
    output: Output,
    profile_name: str | None,
    like: Path | None,
    model_file: Path | None,
    duration_s: float | None,
    noise_nm: float,
    seed: int,
    out: Path,
) -> None:
    """Compute the bench model, alone or on a measured motion."""
    _check_out(out, like)
    profile = choose_profile(profile_name, like)
    model = load_model(model_file) if model_file else BenchModel.from_profile(profile.data)
    rng = np.random.default_rng(seed)
    if like is not None:
        measured = read_trace(resolve_input(like), require=("velocity",))
        trace = with_noise(simulate_like(measured, profile.data, model), noise_nm, rng)
    else:
        plan = profile.data.ripple
        trace = simulate_run(
            profile.data,
            model,
            duration_s=plan.duration_s if duration_s is None else duration_s,
            wave=plan.reference,
            noise_nm=noise_nm,
            rng=rng,
        )
    write_trace(out, trace)
    lost = int((~trace.valid("torque_nm")).sum())
    body = {
        "file": str(out),
        "like": None if like is None else str(like),
        "model": None if model_file is None else str(model_file),
        "terms": list(model.terms()),
        "noise_nm": noise_nm,
        "seed": seed,
        **_summary(trace),
        "lost_samples": lost,
    }
    output.result(body, _lines(body), kind="simulation", profile=profile)
    if lost:
        output.end(
            DoubtfulDataError(
                f"{lost} of {len(trace)} samples of the motion are lost; their torque is empty",
                where=str(like),
                fix="use the samples that are there, or measure again",
            )
        )


def _check_out(out: Path, like: Path | None) -> None:
    """Refuse to write over the measured trace."""
    if not out.name.endswith((".csv", ".csv.gz")):
        raise UsageError(
            f"{out.name} has no trace's ending; needed: .csv or .csv.gz",
            where="--out",
            fix=f"write to {out.name}.csv",
        )
    inputs = [] if like is None else [like.resolve(), (like / "trace.csv").resolve()]
    if out.resolve() in inputs:
        raise UsageError(
            f"{out} is the measured trace; needed: another file",
            where="--out",
            fix="name a new file",
        )


def _summary(trace: Trace) -> dict[str, float | int | None]:
    """Return size and root mean square of the simulated torque."""
    torque = trace["torque_nm"][trace.valid("torque_nm")]
    return {
        "samples": len(trace),
        "duration_s": float(trace.time_s[-1] - trace.time_s[0]),
        "torque_rms_nm": float(np.sqrt(np.mean(torque * torque))) if len(torque) else None,
    }


def _lines(body: Mapping[str, Any]) -> Iterator[str]:
    rms = body["torque_rms_nm"]
    size = "none" if rms is None else f"{rms:.4f} N m rms"
    yield f"torque  {size} over {body['duration_s']:.3f} s"
    yield f"terms   {', '.join(body['terms'])}"
    yield f"file    {body['file']}"
