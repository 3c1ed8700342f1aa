"""`hdbench devices`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

from hdbench.devices.serial_ports import SerialPort, find_ports, probe_port
from hdbench_cli.output import Output

_SLOW_MS = 2  # of an FTDI adapter; its 16 ms at the start are longer than a whole exchange


def devices_command(output: Output, probe: bool) -> None:
    """List the serial ports of this computer with their USB identity."""
    ports = find_ports()
    answers = [probe_port(port) if probe and port.accessible else "" for port in ports]
    asked = list(zip(ports, answers, strict=True))
    found = [{**asdict(port), "answers": answer or None} for port, answer in asked]
    body = {"probed": probe, "ports": found}
    output.result(body, _lines(asked), kind="devices")


def _lines(asked: list[tuple[SerialPort, str]]) -> Iterator[str]:
    if not asked:
        yield "no serial ports on this computer; devices on a network are named by address"
    for port, answer in asked:
        who = " ".join(filter(None, (port.usb_id, port.manufacturer, port.description)))
        number = f"  number {port.serial_number}" if port.serial_number else ""
        yield f"{port.path}  {who or 'no USB identity'}{number}"
        if answer:
            yield f"  answers: {answer}"
        if not port.accessible:
            yield (
                "  fix: this user may not open it: sudo usermod -aG dialout $USER, "
                "then log in again"
            )
        if port.latency_ms is not None and port.latency_ms > _SLOW_MS:
            yield (
                f"  fix: its USB adapter delays characters by {port.latency_ms} ms: "
                f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{port.path.rpartition('/')[2]}"
                "/latency_timer"
            )
