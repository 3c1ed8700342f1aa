"""`hdbench stop`."""

from __future__ import annotations

from dataclasses import asdict

from hdbench.errors import UnsafeError
from hdbench_cli.inputs import choose_profile
from hdbench_cli.options import declared
from hdbench_cli.output import Output


@declared("stop")
def command(output: Output, profile_name: str | None, address: str | None) -> None:
    """Stop the motor of a bench now, whoever runs it, and confirm that it stands still.

    This is no safety function: a bench needs a hard-wired emergency stop.
    """
    from hdbench.devices import stop_bench
    from hdbench.records import result_header

    profile = choose_profile(profile_name, None)
    safe = stop_bench(profile, address=address)
    if not safe.confirmed:
        raise UnsafeError.unconfirmed(safe.detail, where=address or profile.data.daq.address)
    body = {**result_header("stop", profile), **asdict(safe)}
    output.result(body, lambda _body: [f"stopped: {safe.detail}"])
