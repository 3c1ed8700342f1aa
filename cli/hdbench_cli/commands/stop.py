"""`hdbench stop`."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from hdbench.errors import UnsafeError
from hdbench_cli.options import address_option, profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command"]


@click.command("stop", epilog="Example: hdbench stop --address tcp://192.168.0.7:502")
@profile_option
@address_option
@click.pass_obj
def command(output: Output, profile_name: str | None, address: str | None) -> None:
    """Stop the motor of a bench now, whoever runs it, and confirm that it stands.

    This is no safety function: a bench needs a hard-wired emergency stop.
    """
    from hdbench.devices import stop_bench
    from hdbench.profile import load_profile
    from hdbench.records import result_header

    profile = load_profile(profile_name or "cim-tr-97-06")
    safe = stop_bench(profile, address=address)
    if not safe.confirmed:
        raise UnsafeError.unconfirmed(safe.detail, where=address or profile.data.daq.address)

    def text(console: Console) -> None:
        console.print(f"stopped: {safe.detail}", markup=False)

    output.result({**result_header("stop", profile), **asdict(safe)}, text)
