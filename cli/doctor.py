"""`hdbench doctor`."""

from __future__ import annotations

import platform
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hdbench.errors import HdbenchError, LimitError
from hdbench_cli.options import address_option, profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.profile import Profile

__all__ = ["command", "version_facts"]

_MIB = 2.0**20
_NEEDED_MIB = 200.0  # ten runs of ten minutes at 1 kHz are about that


@dataclass(frozen=True, slots=True)
class _Line:
    name: str
    ok: bool
    found: str
    fix: str = ""


def version_facts() -> dict[str, str]:
    """Return versions of hdbench, its filter kernel and the libraries under it.

    Returns
    -------
    dict of str to str
        Name to version; `kernel` says which form of the filter runs and why.
    """
    from importlib.metadata import version

    from hdbench import __version__
    from hdbench.filter import kernel_name, kernel_reason

    return {
        "hdbench_version": __version__,
        "kernel": f"{kernel_name()} ({kernel_reason()})",
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "pymodbus": version("pymodbus"),
    }


def _environment() -> list[_Line]:
    from hdbench.filter import kernel_name, kernel_reason

    free_mib = shutil.disk_usage(Path.cwd()).free / _MIB
    compiled = kernel_name() == "c"
    return [
        _Line("python", True, platform.python_version()),
        _Line(
            "filter kernel",
            True,
            f"{kernel_name()}: {kernel_reason()}",
            "" if compiled else "for speed install a C compiler, then install hdbench again",
        ),
        _Line(
            "disk",
            free_mib > _NEEDED_MIB,
            f"{free_mib:.0f} MiB free in {Path.cwd()}",
            f"free at least {_NEEDED_MIB:.0f} MiB",
        ),
    ]


def _bench(profile: Profile, address: str | None) -> list[_Line]:
    from hdbench.devices import open_bench

    where = address or profile.data.daq.address
    try:
        with open_bench(profile.data, address=address) as bench:
            identity = bench.identity()
            safe = bench.safe_state()
    except HdbenchError as error:
        return [_Line("bench", False, f"{error.where}: {error.what}", error.fix)]
    who = f"{identity.vendor} {identity.model} {identity.firmware} at {where}"
    return [
        _Line("bench", True, who + (" (simulated)" if identity.simulated else "")),
        _Line("safe state", safe.confirmed, safe.detail, "press the emergency stop and look"),
    ]


@click.command("doctor", epilog="Example: hdbench doctor --profile my-bench.toml --json")
@profile_option
@address_option
@click.pass_obj
def command(output: Output, profile_name: str | None, address: str | None) -> None:
    """Check this installation, the profile and the bench; each line with its fix.

    Exits 3 when a line fails. The motor does not move.
    """
    from hdbench.profile import load_profile

    lines = _environment()
    try:
        profile = load_profile(profile_name or "cim-tr-97-06")
    except HdbenchError as error:
        lines.append(_Line("profile", False, error.what, error.fix))
    else:
        lines.append(_Line("profile", True, f"{profile.data.name} {profile.sha256[:12]}"))
        lines.extend(_bench(profile, address))
    ok = all(line.ok for line in lines)

    def text(console: Console) -> None:
        for line in lines:
            mark = "[green]ok  [/]" if line.ok else "[bold red]FAIL[/]"
            console.print(mark, end=" ")
            console.print(f"{line.name:14s} {line.found}", markup=False)
            if (line.fix and not line.ok) or (line.fix and line.name == "filter kernel"):
                console.print(f"       fix: {line.fix}", markup=False)

    facts = version_facts()
    body = {"schema": "hdbench/doctor/1", "ok": ok, "lines": [asdict(x) for x in lines], **facts}
    output.result(body, text)
    if not ok:
        failed = LimitError("a check failed", where="doctor", fix="see the lines above")
        if output.json:
            raise click.exceptions.Exit(failed.exit_code)
        raise failed
