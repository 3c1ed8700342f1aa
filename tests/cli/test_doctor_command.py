"""`doctor` and `devices`: every line says what was found and how to mend it."""

import json
import os

import click
import pytest
from click.testing import CliRunner

from hdbench.devices import serial_ports
from hdbench.devices.serial_ports import SerialPort, latency_timer_ms, probe_port
from hdbench_cli.commands import devices as devices_module
from hdbench_cli.commands import doctor as doctor_module
from hdbench_cli.output import Output


def call(command: click.Command, *words: str) -> tuple[int, dict[str, object]]:
    done = CliRunner().invoke(command, list(words), obj=Output(json=True))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, json.loads(done.stdout)


def test_a_sound_bench_passes_every_line(tmp_path):
    code, body = call(doctor_module.command, "--out", str(tmp_path))
    assert code == 0
    names = [line["name"] for line in body["lines"]]
    assert {
        "python", "filter kernel", "drivers", "clock", "disk", "profile", "calibration", "device",
        "watchdog", "guard", "safe state",
    } <= set(names)  # fmt: skip
    assert body["ok"] is True


def test_a_bench_that_does_not_answer_and_a_port_that_is_not_there_fail_with_their_fix(tmp_path):
    code, body = call(
        doctor_module.command, "--out", str(tmp_path), "--address", f"rtu://{tmp_path}/none"
    )
    assert code == 3
    lines = {line["name"]: line for line in body["lines"]}
    assert lines["port"]["ok"] is False
    assert "hdbench devices" in lines["port"]["fix"]
    assert lines["device"]["ok"] is False
    assert lines["device"]["fix"]


def test_the_proof_moves_nothing_unless_it_is_confirmed(tmp_path):
    from hdbench.errors import UsageError

    with pytest.raises(UsageError, match="needs a confirmation"):
        call(doctor_module.command, "--out", str(tmp_path), "--prove-watchdog", "--no-input")


def port(path: str, **changes: object) -> SerialPort:
    base = {
        "path": path, "description": "USB Serial", "manufacturer": "FTDI", "serial_number": "A1",
        "usb_id": "0403:6001", "accessible": True, "latency_ms": 16,
    }  # fmt: skip
    return SerialPort(**{**base, **changes})


def test_devices_lists_ports_with_their_usb_identity_and_asks_nobody(monkeypatch):
    monkeypatch.setattr(serial_ports, "find_ports", lambda: (port("/dev/ttyUSB7"),))
    monkeypatch.setattr(serial_ports, "probe_port", lambda _port: pytest.fail("asked"))
    code, body = call(devices_module.command)
    assert code == 0
    (found,) = body["ports"]
    assert found["usb_id"] == "0403:6001"
    assert found["answers"] is None


def test_a_slow_adapter_and_missing_rights_are_told_with_their_fix(monkeypatch):
    slow = port("/dev/ttyUSB7", accessible=False)
    monkeypatch.setattr(serial_ports, "find_ports", lambda: (slow,))
    done = CliRunner().invoke(devices_module.command, ["--probe"], obj=Output())
    assert "latency_timer" in done.stdout
    assert "dialout" in done.stdout


def test_probing_a_line_where_nobody_answers_says_so(tmp_path):
    near, far = os.openpty()
    try:
        assert "nobody" in probe_port(port(os.ttyname(far)))
    finally:
        os.close(near)
        os.close(far)


def test_the_latency_timer_is_read_where_the_system_shows_it(tmp_path):
    folder = tmp_path / "ttyUSB7"
    folder.mkdir()
    (folder / "latency_timer").write_text("16\n")
    assert latency_timer_ms("/dev/ttyUSB7", tmp_path) == 16
    assert latency_timer_ms("/dev/ttyUSB8", tmp_path) is None
