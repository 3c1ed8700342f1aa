"""`hdbench devices`."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.devices.serial_ports import SerialPort

__all__ = ["command"]

_SLOW_MS = 2  # of an FTDI adapter; its 16 ms at the start are longer than a whole exchange


@click.command("devices", epilog="Example: hdbench devices --probe --json")
@click.option("--probe", is_flag=True, help="Ask who is there: sends a few bytes on every port.")
@click.pass_obj
def command(output: Output, probe: bool) -> None:
    """List the serial ports of this computer with their USB identity.

    Nothing is opened or sent, but with --probe: then every port that this user may open is asked
    as the installed drivers ask. A device that none of them knows gets bytes that it does not know:
    leave --probe out where that matters.
    """
    from hdbench.devices.serial_ports import find_ports, probe_port
    from hdbench.records import result_header

    ports = find_ports()
    answers = [probe_port(port) if probe and port.accessible else "" for port in ports]
    found = [
        {**asdict(port), "answers": answer or None}
        for port, answer in zip(ports, answers, strict=True)
    ]
    output.result(
        {**result_header("devices", None), "probed": probe, "ports": found},
        lambda console: _draw(console, ports, answers),
    )


def _draw(console: Console, ports: tuple[SerialPort, ...], answers: list[str]) -> None:
    from rich.text import Text

    if not ports:
        console.print("no serial ports on this computer; devices on a network are named by address")
    for port, answer in zip(ports, answers, strict=True):
        who = " ".join(filter(None, (port.usb_id, port.manufacturer, port.description)))
        number = f"  number {port.serial_number}" if port.serial_number else ""
        console.print(Text(f"{port.path}  {who or 'no USB identity'}{number}"), soft_wrap=True)
        if answer:
            console.print(Text(f"  answers: {answer}"), soft_wrap=True)
        for note in _notes(port):
            console.print(Text(f"  fix: {note}"), soft_wrap=True)


def _notes(port: SerialPort) -> list[str]:
    notes = []
    if not port.accessible:
        notes.append("this user may not open it: sudo usermod -aG dialout $USER, then log in again")
    if port.latency_ms is not None and port.latency_ms > _SLOW_MS:
        notes.append(
            f"its adapter holds characters back for {port.latency_ms} ms: "
            f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{port.path.rpartition('/')[2]}"
            "/latency_timer"
        )
    return notes
