"""Findings of `hdbench doctor`: what was looked at, what was found, how to mend it."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from hdbench.devices import open_bench
from hdbench.devices.driver import drivers
from hdbench.devices.host.bench import HostedBench
from hdbench.devices.lock import is_line
from hdbench.devices.opening import addresses_of
from hdbench.devices.serial_ports import latency_timer_ms
from hdbench.errors import DataError, HdbenchError
from hdbench.filter import kernel_name, kernel_reason
from hdbench.profile import Profile
from hdbench.profile.scaling import calibration_time
from hdbench.records import list_runs
from hdbench.records.jsonfile import read_json

_MIB = 2.0**20
_NEEDED_MIB = 200.0  # ten runs of ten minutes at 1 kHz are about that
# the year in which this was written: a clock before it was never set
_FIRST_YEAR = 2025
# an FTDI adapter holds characters back for this long, ms; 16 at its start, longer than an exchange
_LATENCY_MS = 2


@dataclass(frozen=True, slots=True)
class Finding:
    """One line."""

    name: str
    ok: bool
    found: str
    fix: str = ""


def check_computer(folder: Path) -> list[Finding]:
    """Look at interpreter, filter kernel, drivers, clock and disk."""
    compiled = kernel_name() == "c"
    return [
        Finding("python", True, f"{platform.python_version()} on {platform.platform()}"),
        Finding(
            "filter kernel",
            True,
            f"{kernel_name()}: {kernel_reason()}",
            "" if compiled else "for speed install a C compiler, then install hdbench again",
        ),
        *_drivers(),
        _clock(datetime.now(UTC)),
        _disk(folder),
    ]


def _drivers() -> Iterator[Finding]:
    installed = drivers()
    names = ", ".join(f"{info.name} ({info.origin})" for info in installed if not info.problem)
    yield Finding("drivers", True, names)
    for info in installed:
        if info.problem:
            yield Finding(
                "driver",
                info.origin == "hdbench",
                f"{info.name} ({info.origin}) cannot be used: {info.problem}",
                "install its package again",
            )


def _clock(now: datetime) -> Finding:
    fix = "set the clock, or start its synchronisation: timedatectl set-ntp true"
    if now.year < _FIRST_YEAR:
        return Finding("clock", False, f"{now:%Y-%m-%d %H:%M} UTC: it was never set", fix)
    synchronised = _synchronised()
    words = {True: ", synchronised", False: ", NOT synchronised", None: ""}[synchronised]
    shown = f"{now:%Y-%m-%d %H:%M} UTC{words}"
    return Finding("clock", True, shown, fix if synchronised is False else "")


def _synchronised() -> bool | None:
    """Return whether the system's clock follows a time server; None where nobody tells."""
    tool = shutil.which("timedatectl")
    if tool is None:
        return None
    try:
        done = subprocess.run(
            [tool, "show", "-p", "NTPSynchronized", "--value"],
            capture_output=True,
            text=True,
            timeout=2.0,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return {"yes": True, "no": False}.get(done.stdout.strip())


def _disk(folder: Path) -> Finding:
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    free_mib = shutil.disk_usage(place).free / _MIB
    writable = os.access(place, os.W_OK)
    found = f"{free_mib:.0f} MiB free in {place}" + ("" if writable else ", which is read-only")
    fix = f"free at least {_NEEDED_MIB:.0f} MiB" if writable else "choose a folder of your own"
    return Finding("disk", writable and free_mib > _NEEDED_MIB, found, fix)


def check_ports(profile: Profile, address: str | None) -> list[Finding]:
    """Look at the serial ports that the profile names: there, allowed, quick enough."""
    findings: list[Finding] = []
    table = profile.data.daq
    for name in addresses_of(table.model_copy(update={"address": address or table.address})):
        if is_line(name):
            findings += _port(name.partition("://")[2])
    return findings


def _port(path: str) -> Iterator[Finding]:
    if not Path(path).exists():
        yield Finding("port", False, f"{path} is not there", "plug it in; see: hdbench devices")
        return
    allowed = os.access(path, os.R_OK | os.W_OK)
    fix = "sudo usermod -aG dialout $USER, then log in again"
    yield Finding("port", allowed, path if allowed else f"no rights on {path}", fix)
    latency_ms = latency_timer_ms(path)
    if latency_ms is not None:
        place = f"/sys/bus/usb-serial/devices/{Path(path).name}/latency_timer"
        yield Finding(
            "latency timer",
            latency_ms <= _LATENCY_MS,
            f"{path} holds characters back for {latency_ms} ms; needed: at most {_LATENCY_MS} ms",
            f"echo 1 | sudo tee {place}",
        )


def check_bench(profile: Profile, address: str | None) -> list[Finding]:
    """Ask the device who it is, what watchdog it has, and whether its guard reaches it."""
    where = address or profile.data.daq.address
    findings: list[Finding] = []
    try:
        with open_bench(profile, address=address, realtime=True) as bench:
            identity = bench.identity()
            who = f"{identity.vendor} {identity.model} {identity.serial} {identity.firmware}"
            simulated = " (simulated)" if identity.simulated else ""
            findings.append(Finding("device", True, f"{who} at {where}{simulated}"))
            findings += _watched(bench)
            safe = bench.safe_state()
            fix = "press the emergency stop and look"
            findings.append(Finding("safe state", safe.confirmed, safe.detail, fix))
    except HdbenchError as error:
        findings.append(Finding("device", False, f"{error.where}: {error.what}", error.fix))
    return findings


def _watched(bench: HostedBench) -> Iterator[Finding]:
    able = bench.capabilities()
    if not able.drives:
        yield Finding("watchdog", True, "not needed: this device drives no motor")
        return
    dog = able.watchdog
    if dog is None or not dog.drops:
        fix = "use an output device that has one"
        yield Finding("watchdog", False, "none that stops the motor", fix)
    else:
        found = (
            f"{dog.min_s:g} to {dog.max_s:g} s, fed by {dog.fed_by}, drops {', '.join(dog.drops)}"
        )
        proof = "prove it once per bench: hdbench doctor --prove-watchdog"
        yield Finding("watchdog", True, f"{found}; not proven here", proof)
    try:
        guard = bench.start_guard()
    except HdbenchError as error:
        yield Finding("guard", False, error.what, error.fix)
        return
    if guard is None:
        return
    guard.end()
    found = f"starts and reaches the device; acts after {guard.silence_s:.2g} s of silence"
    yield Finding("guard", True, found)


def check_calibration(profile: Profile, runs: Path, now: datetime) -> Finding:
    """Say how old the newest calibration of this bench is."""
    limit = profile.data.calibration.validity_days
    fix = "hdbench calibrate"
    wanted = ("calibration", "complete", profile.data.name)
    try:
        mine = [
            run.path
            for run in list_runs(runs)
            if (run.kind, run.status, run.profile) == wanted and _accepted(run.path)
        ]
        times = [(calibration_time(path)[0] or "", path) for path in mine]
    except DataError as error:
        return Finding("calibration", False, f"{error.where}: {error.what}", error.fix)
    if not times:
        found = f"none accepted in {runs}; runs use the gain that the profile states"
        return Finding("calibration", True, found, fix)
    utc, path = max(times)
    try:
        age_days = (now - datetime.fromisoformat(utc)).total_seconds() / 86400.0
    except (ValueError, TypeError):
        return Finding("calibration", False, f"{path.name}: date {utc!r:.40} cannot be read", fix)
    found = f"{path.name}, {age_days:.1f} days old; valid for {limit:g}"
    return Finding("calibration", age_days <= limit, found, fix)


def _accepted(run: Path) -> bool:
    file = run / "result.json"
    return file.is_file() and read_json(file).get("accepted") is True
