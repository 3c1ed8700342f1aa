"""`hdbench monitor`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from hdbench.filter.presets import choose_filter
from hdbench.profile.scaling import profile_scale, read_calibration
from hdbench.session.monitor import observe
from hdbench.session.stop import listen
from hdbench_cli.inputs import choose_profile
from hdbench_cli.live.view import live_view
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, table

_NUMBERS = ("mean", "std", "min", "max")


def _lines(result: Mapping[str, Any]) -> Lines:
    """Yield mean, scatter and range of every channel."""
    yield (
        f"{result['samples']} samples in {result['seconds']:.1f} s, {result['lost']} lost, "
        f"{result['saturated']} saturated; drive disabled throughout"
    )
    rows = []
    for name, channel in result["channels"].items():
        cells = [channel[key] for key in _NUMBERS]
        shown = ["-" if cell is None else f"{cell:.5g}" for cell in cells]
        rows.append((name, *shown, channel["unit"]))
    yield table(("channel", *_NUMBERS, "unit"), rows, right=_NUMBERS)


def monitor_command(
    output: Output,
    profile_name: str | None,
    address: str | None,
    calibration: Path | None,
    filter_name: str | None,
    duration_s: float | None,
    plant: str,
    seed: int,
) -> None:
    """Watch a bench live, with its drive disabled: nothing moves and nothing is stored."""
    profile = choose_profile(profile_name, None)
    scale = read_calibration(calibration) if calibration else profile_scale(profile)
    model = choose_filter(profile, filter_name, misalignment=None)
    with listen() as stop, live_view("monitor", profile, Path()) as watcher:
        seen = observe(
            profile,
            scale,
            model,
            watcher,
            stop,
            duration_s=duration_s,
            address=address,
            plant=plant,
            seed=seed,
        )
    body = {"torque_scale": scale.to_dict(), **asdict(seen)}
    signum = body.pop("stopped_by")
    output.result(body, _lines(body), kind="monitor", profile=profile)
    if signum is not None:
        raise click.exceptions.Exit(128 + signum)
