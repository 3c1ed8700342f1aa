"""`hdbench emulate`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hdbench.devices.emulator.machine import Pace
from hdbench.devices.emulator.server import Wire
from hdbench.devices.emulator.serving import EmulatorSettings, emulate
from hdbench.errors import UsageError
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def emulate_command(
    output: Output,
    profile_name: str | None,
    plant: str,
    model_file: Path | None,
    seed: int,
    port: int,
    wire: Wire,
    listen: str,
    unprotected: bool,
    pace: Pace,
    record: Path | None,
) -> None:
    """Serve the emulated bench on its own wire until Ctrl-C or SIGTERM."""
    _check_listen(listen, unprotected=unprotected)
    profile = choose_profile(profile_name, None)

    def ready(found: Mapping[str, object]) -> None:
        address = str(found["address"])
        parts = [found[name] for name in ("inputs", "outputs") if name in found]
        each = [str(part["address"]) for part in parts if isinstance(part, dict)]
        served = {**found, **_host_and_port(address), "plant": plant, "seed": seed, "pace": pace}
        output.result(served, each or [address], kind="emulator", profile=profile)
        output.note(f"lock and weights by a simulated operator: --control {found['control']}")
        output.note("serving until Ctrl-C")

    settings = EmulatorSettings(host=listen, port=port, pace=pace, record=record, wire=wire)
    emulate(profile.data, plant, seed, settings, ready=ready, model_file=model_file)


def _check_listen(listen: str, *, unprotected: bool) -> None:
    """Refuse to open the wire to a network by accident."""
    if listen in _LOOPBACK or unprotected:
        return
    if listen.rpartition(":")[0] in _LOOPBACK:
        raise UsageError(
            f"{listen} holds a port; needed: an address alone",
            where="--listen",
            fix="give the port with --port",
        )
    raise UsageError(
        f"{listen} is not the loopback: everybody on that network could move the bench",
        where="--listen",
        fix="leave it out, or add --unprotected if that is what you want",
    )


def _host_and_port(address: str) -> dict[str, object]:
    """Return host and port of a network address; nothing for another."""
    host, _, port = address.partition("://")[2].rpartition(":")
    return {"host": host, "port": int(port)} if host and port.isdecimal() else {}
