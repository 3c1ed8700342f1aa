"""`hdbench monitor`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.inputs import choose_profile
from hdbench_cli.options import declared
from hdbench_cli.output import Output
from hdbench_cli.text import table

if TYPE_CHECKING:
    from rich.console import RenderableType

_NUMBERS = ("mean", "std", "min", "max")


def _lines(result: Mapping[str, Any]) -> Iterator[RenderableType]:
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


@declared("monitor")
def command(
    output: Output,
    profile_name: str | None,
    address: str | None,
    calibration: Path | None,
    filter_name: str | None,
    duration_s: float | None,
    plant: str,
    seed: int,
) -> None:
    """Watch a bench live, with its drive disabled: nothing moves and nothing is stored.

    Shows what the live view of a run shows, and at the end mean, scatter and range of each channel:
    enough to see a dead gauge, a loose plug, a wrong sign or mains hum before a run. A bench that
    a run holds is left alone (exit 9).
    """
    from dataclasses import asdict

    from hdbench.profile.scaling import profile_scale, read_calibration
    from hdbench.records import result_header
    from hdbench.session.filters import choose_filter
    from hdbench.session.monitor import observe
    from hdbench.session.stop import listen
    from hdbench_cli.live.view import live_view

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
    body = {
        **result_header("monitor", profile),
        "torque_scale": scale.to_dict(),
        **asdict(seen),
    }
    signum = body.pop("stopped_by")
    output.result(body, _lines)
    if signum is not None:
        raise click.exceptions.Exit(128 + signum)
