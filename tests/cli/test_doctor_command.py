"""`doctor` and `devices`: every line says what was found and how to mend it."""

import os

import pytest

from hdbench.devices.serial_ports import SerialPort, latency_timer_ms, probe_port
from hdbench_cli.commands import devices


def test_a_sound_bench_passes_every_line(tmp_path, answer):
    body = answer("doctor", "--out", tmp_path)
    names = [line["name"] for line in body["lines"]]
    assert {
        "python", "filter kernel", "drivers", "clock", "disk", "profile", "calibration", "device",
        "watchdog", "guard", "safe state",
    } <= set(names)  # fmt: skip
    assert body["ok"] is True


def test_a_bench_that_does_not_answer_and_a_missing_port_fail_with_their_fix(tmp_path, answer):
    body = answer("doctor", "--out", tmp_path, "--address", f"rtu://{tmp_path}/none", code=3)
    lines = {line["name"]: line for line in body["lines"]}
    assert lines["port"]["ok"] is False
    assert "hdbench devices" in lines["port"]["fix"]
    assert lines["device"]["ok"] is False
    assert lines["device"]["fix"]


def test_the_proof_moves_nothing_unless_it_is_confirmed(tmp_path, hdbench):
    words = ("doctor", "--out", tmp_path, "--prove-watchdog", "--no-input")
    assert "needs a confirmation" in hdbench(*words, code=2)[1]


def port(path: str, **changes: object) -> SerialPort:
    base = {
        "path": path, "description": "USB Serial", "manufacturer": "FTDI", "serial_number": "A1",
        "usb_id": "0403:6001", "accessible": True, "latency_ms": 16,
    }  # fmt: skip
    return SerialPort(**{**base, **changes})


def test_devices_lists_ports_with_their_usb_identity_and_asks_nobody(monkeypatch, answer):
    monkeypatch.setattr(devices, "find_ports", lambda: (port("/dev/ttyUSB7"),))
    monkeypatch.setattr(devices, "probe_port", lambda _port: pytest.fail("asked"))
    (found,) = answer("devices")["ports"]
    assert found["usb_id"] == "0403:6001"
    assert found["answers"] is None


def test_a_slow_adapter_and_missing_rights_are_told_with_their_fix(monkeypatch, hdbench):
    slow = port("/dev/ttyUSB7", accessible=False)
    monkeypatch.setattr(devices, "find_ports", lambda: (slow,))
    told, _ = hdbench("devices", "--probe")
    assert "latency_timer" in told
    assert "dialout" in told


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
