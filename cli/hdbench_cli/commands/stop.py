"""`hdbench stop`."""

from __future__ import annotations

from dataclasses import asdict

from hdbench.devices import stop_bench
from hdbench.errors import UnsafeError
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output


def stop_command(output: Output, profile_name: str | None, address: str | None) -> None:
    """Stop the motor of a bench now, whoever runs it, and confirm that it stands still."""
    profile = choose_profile(profile_name, None)
    safe = stop_bench(profile, address=address)
    if not safe.confirmed:
        raise UnsafeError.unconfirmed(safe.detail, where=address or profile.data.daq.address)
    output.result(asdict(safe), [f"stopped: {safe.detail}"], kind="stop", profile=profile)
