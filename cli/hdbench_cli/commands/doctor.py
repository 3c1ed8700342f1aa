"""`hdbench doctor`."""

from __future__ import annotations

import platform
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import click

from hdbench import __version__
from hdbench.errors import HdbenchError, LimitError, Stopped, UsageError
from hdbench.filter import kernel_name, kernel_reason
from hdbench.profile import Profile
from hdbench.session.doctor import (
    Finding,
    check_bench,
    check_calibration,
    check_computer,
    check_ports,
)
from hdbench.session.stop import StopRequested, listen
from hdbench.session.watchdogproof import WatchdogProof, creep_rad_s, prove_watchdog
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, styled

_PROOF_FIX = "let nothing move here until the device's watchdog stops the motor"
# lines that are well, and say what could still be done
_HINTS = ("filter kernel", "watchdog", "calibration", "clock")


def version_facts() -> dict[str, str]:
    """Return versions of hdbench, its filter kernel and the libraries under it."""
    return {
        "hdbench_version": __version__,
        "kernel": f"{kernel_name()} ({kernel_reason()})",
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "pyserial": version("pyserial"),
    }


def doctor_command(
    output: Output,
    profile_name: str | None,
    address: str | None,
    out: Path,
    prove: bool,
    yes: bool,
    no_input: bool,
) -> None:
    """Check this computer, the profile and the bench; each line with its fix."""
    findings = check_computer(out)
    proof = None
    try:
        profile = choose_profile(profile_name, None)
    except HdbenchError as error:
        findings.append(Finding("profile", False, error.what, error.fix))
    else:
        findings.append(Finding("profile", True, f"{profile.data.name} {profile.sha256[:12]}"))
        findings.append(check_calibration(profile, out, datetime.now(UTC)))
        findings += check_ports(profile, address)
        findings += check_bench(profile, address)
        if prove:
            proof = _proof(output, profile, address, yes=yes, no_input=no_input)
            found = Finding("watchdog", proof.proven, proof.detail, _PROOF_FIX)
            findings = [*(line for line in findings if line.name != "watchdog"), found]
    _tell(output, findings, proof)


def _proof(
    output: Output, profile: Profile, address: str | None, *, yes: bool, no_input: bool
) -> WatchdogProof:
    """Ask, then prove."""
    where = address or profile.data.daq.address
    speed = creep_rad_s(profile.data)
    if not yes:
        if no_input:
            raise UsageError(
                "--prove-watchdog moves the motor and needs a confirmation",
                where="--no-input",
                fix="add --yes when the bench is clear",
            )
        output.note(f"The motor of {where} will turn at {speed:.3g} rad/s for some seconds.")
        click.confirm("Is the bench clear, and the emergency stop at hand?", abort=True, err=True)
    with listen() as stop:
        try:
            return prove_watchdog(profile, stop, address=address)
        except StopRequested as request:
            raise Stopped(
                f"stopped by {request}; motor reference zero confirmed",
                where=where,
                fix="prove the watchdog again",
                exit_code=128 + request.signum,
            ) from request


def _tell(output: Output, findings: list[Finding], proof: WatchdogProof | None) -> None:
    ok = all(line.ok for line in findings)
    body = {"ok": ok, "lines": [asdict(line) for line in findings], **version_facts()}
    if proof is not None:
        body["watchdog_proof"] = asdict(proof)
    output.result(body, _lines(findings), kind="doctor")
    if not ok:
        output.end(LimitError("a check failed", where="doctor", fix="see the lines above"))


def _lines(findings: list[Finding]) -> Lines:
    for line in findings:
        mark = ("ok   ", "green") if line.ok else ("FAIL ", "bold red")
        yield styled(mark, f"{line.name:14s} {line.found}")
        if line.fix and not line.ok:
            yield f"       fix: {line.fix}"
        elif line.fix and line.name in _HINTS:
            yield f"       hint: {line.fix}"
