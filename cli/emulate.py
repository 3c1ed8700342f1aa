"""`hdbench emulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hdbench_cli.options import profile_option, seed_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command"]


@click.command("emulate", epilog="Example: hdbench emulate --plant worn --port 5020")
@profile_option
@click.option(
    "--plant",
    metavar="NAME|FILE",
    default="as-modelled",
    show_default=True,
    help="What the bench has beyond its model.",
)
@click.option(
    "--model",
    "model_file",
    metavar="FILE",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Bench model to emulate, such as a diagnosis' extended one; else the profile's.",
)
@seed_option
@click.option(
    "--port",
    metavar="PORT",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="TCP port on 127.0.0.1; 0 takes a free one.",
)
@click.option(
    "--pace",
    type=click.Choice(["realtime", "fast"]),
    default="realtime",
    show_default=True,
    help="Sample by the wall clock, or as fast as the host reads.",
)
@click.option(
    "--record",
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write each change of the node's state as one JSON line.",
)
@click.pass_obj
def command(
    output: Output,
    *,
    profile_name: str | None,
    plant: str,
    model_file: Path | None,
    seed: int,
    port: int,
    pace: str,
    record: Path | None,
) -> None:
    """Serve the emulated bench over Modbus TCP until Ctrl-C or SIGTERM.

    Prints the address that --address of the other commands takes. The port is open to this machine
    only: Modbus has no authentication.
    """
    from hdbench import __version__
    from hdbench.devices.emulator.serve import EmulatorSettings, emulate_bench
    from hdbench.profile import load_profile

    profile = load_profile(profile_name or "cim-tr-97-06")

    def ready(host: str, bound: int) -> None:
        address = f"tcp://{host}:{bound}"

        def show(console: Console) -> None:
            console.print(address, highlight=False, markup=False)

        output.result(
            {
                "schema": "hdbench/emulator/1",
                "hdbench_version": __version__,
                "profile": {"name": profile.name, "sha256": profile.sha256},
                "address": address,
                "host": host,
                "port": bound,
                "plant": plant,
                "seed": seed,
                "pace": pace,
            },
            show,
        )
        output.note("serving until Ctrl-C")

    settings = EmulatorSettings(
        port=port, pace="fast" if pace == "fast" else "realtime", record=record
    )
    emulate_bench(profile.data, plant, seed, settings, ready=ready, model_file=model_file)
