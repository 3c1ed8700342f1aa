"""Drivers by name, those of other packages too; a broken one is told, not fatal."""

import re
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from forked import ended

from hdbench.devices.driver import drivers, open_daq
from hdbench.devices.node.driver import NodeDaq
from hdbench.devices.wire.address import parse_address
from hdbench.drivers.dataq.port import port_path
from hdbench.errors import UsageError
from hdbench.profile import acquiring as installed
from hdbench.profile import load_profile
from hdbench.profile.acquiring import NodeAcquisition, PluginAcquisition

PROFILE = load_profile("cim-tr-97-06").data


def _table(driver, **options):
    return PluginAcquisition.model_construct(driver=driver, sample_period_s=0.01, options=options)


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    """Install entry points: one good, one broken, one that takes a built-in name."""
    (tmp_path / "acme_daq.py").write_text(
        "from hdbench.devices.driver import Driver\n"
        "DRIVER = Driver(open=lambda profile, table: ('acme', profile.name, table.options))\n"
        "number = 3\n"
    )
    (tmp_path / "broken_daq.py").write_text("import no_such_module_anywhere\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    points = EntryPoints(
        EntryPoint(name, place, "hdbench.drivers")
        for name, place in (
            ("acme", "acme_daq:DRIVER"),
            ("broken", "broken_daq:DRIVER"),
            ("number", "acme_daq:number"),
            ("node", "acme_daq:DRIVER"),
        )
    )
    monkeypatch.setattr(installed, "entry_points", lambda **words: points.select(**words))
    yield
    for name in ("acme_daq", "broken_daq"):
        sys.modules.pop(name, None)


def test_a_driver_of_another_package_is_opened_with_its_own_keys(plugins):
    found = open_daq(PROFILE, _table("acme", gain=4, line="A"))
    assert found == ("acme", "cim-tr-97-06", {"gain": 4, "line": "A"})


def test_a_broken_driver_is_named_with_its_reason_and_stops_nothing_else(plugins):
    found = {info.name: info for info in drivers()}
    assert found["acme"].problem == ""
    assert "no_such_module_anywhere" in found["broken"].problem
    assert "no Driver" in found["number"].problem
    with pytest.raises(UsageError, match="no_such_module_anywhere") as caught:
        open_daq(PROFILE, _table("broken"))
    assert (caught.value.where, bool(caught.value.fix)) == ("key daq.driver", True)


ACME = {
    "acme-1.0.dist-info/METADATA": "Name: acme\nVersion: 1.0\n",
    "acme-1.0.dist-info/entry_points.txt": """
[hdbench.drivers]
acme = acme_daq:DRIVER
broken = acme_daq:DRIVER
[hdbench.tables]
acme = acme_table:AcmeTable
broken = acme_table:nothing
""",
    "acme_daq.py": """
from hdbench.devices.driver import Driver
DRIVER = Driver(open=lambda profile, table: None, rate_hz=lambda table: 10.0 * table.gain)
""",
    "acme_table.py": """
from typing import Annotated, Literal
from pydantic import Field
from hdbench.profile.acquiring import Acquisition
class AcmeTable(Acquisition):
    driver: Literal["acme"]
    gain: Annotated[int, Field(ge=1, description="gain of the amplifier")]
""",
    "host.py": """
import acme_table
from hdbench.devices.driver import driver_of, drivers
from hdbench.errors import ProfileError
from hdbench.profile import load_profile, parse_profile, profile_schema
head, rest = load_profile("cim-tr-97-06").text.split("[daq]", 1)
tail = "[limits]" + rest.split("[limits]", 1)[1]
def parse(keys):
    text = f"{head}[daq]\\nsample_period_s = 0.1\\n{keys}\\n{tail}"
    return parse_profile(text, "acme.toml").data
table = parse("driver = 'acme'\\ngain = 3").daq
print(driver_of("acme").rate_hz(table))
print("gain of the amplifier" in str(profile_schema()))
print([info.problem for info in drivers() if info.name in ("acme", "broken")])
for keys in ("driver = 'acme'\\ngian = 3", "driver = 'broken'"):
    try:
        parse(keys)
    except ProfileError as error:
        for problem in error.problems or (error,):
            print(problem.what, problem.fix)
""",
}


def test_a_driver_of_another_package_may_bring_its_own_table(tmp_path):
    """In a process of its own: the tables are looked up once."""
    for name, text in ACME.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    done = ended([sys.executable, tmp_path / "host.py"])
    assert done.returncode == 0, done.stderr
    rate, schema, problems, *told = done.stdout.splitlines()
    assert (rate, schema) == ("30.0", "True")
    assert problems.startswith("['', \"AttributeError")
    assert any("'daq.gian': unknown" in line and "did you mean 'daq.gain'" in line for line in told)
    assert any("table cannot be loaded (AttributeError" in line for line in told)


def test_no_plugin_takes_the_name_of_a_built_in_driver(plugins):
    assert [info.problem for info in drivers() if info.name == "node"] == ["", "its name is taken"]
    there = PROFILE.daq.model_copy(update={"address": "tcp://h:1"})
    assert isinstance(open_daq(PROFILE, there), NodeDaq)


def test_the_documents_say_of_each_driver_what_it_was_tested_on():
    text = (Path(__file__).parents[2] / "docs" / "devices.md").read_text(encoding="utf-8")
    for info in drivers():
        if info.origin == "hdbench":
            assert re.search(rf"\| `{info.name}` \|.*\| emulator only \|", text), info.name


def test_an_unknown_driver_is_told_with_the_nearest_name(plugins):
    with pytest.raises(UsageError, match="no driver 'acne'") as caught:
        open_daq(PROFILE, _table("acne"))
    assert caught.value.fix == "did you mean 'acme'?"


REFUSED_ADDRESSES = {
    "tcp://HOST:PORT": ["tcp://h", "h:5", "ftp://h:5", "tcp://:5"],
    "port": ["tcp://h:0", "tcp://h:99999", "tcp://h:1e3"],
    "host name": ["tcp://a b:1", "tls://:802"],
    "IPv6": ["tcp://fd00::7:502"],
    "serial port": [
        "rtu://", "rtu:///dev/../etc/passwd", "rtu:///dev/a b", "rtu://ttyUSB0", "rtu://COM3/..",
    ],
    "such as /dev/ttyUSB0 or COM3": ["rtu://COM"],
    "1200 to 4000000": ["rtu:///dev/ttyUSB0?baud=0"],
    "whole number": ["rtu:///dev/ttyUSB0?baud=fast"],
    "none, even or odd": ["rtu:///dev/ttyUSB0?parity=mark"],
    "1 to 2": ["rtu:///dev/ttyUSB0?stop=3"],
    "'speed' is no key": ["rtu:///dev/ttyUSB0?speed=9600"],
    "rtu://": ["serial:///dev/ttyUSB0", "embedded", "\x1b[31m"],
    "port from 1 to 65535": ["rtu+tcp://10.0.0.7"],
    "serial port after ascii://": ["ascii://"],
    "RTU needs 8": ["rtu:///dev/ttyUSB0?bits=7"],
    "7 to 8": ["ascii:///dev/ttyUSB0?bits=9"],
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "text"),
    [(words, text) for words, texts in REFUSED_ADDRESSES.items() for text in texts],
)
def test_an_address_of_another_form_is_refused(words, text):
    with pytest.raises(UsageError, match=words) as caught:
        parse_address(text)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize(
    "port",
    [
        "COM3",
        "COM12",
        "/dev/cu.usbmodem1",
        "/dev/cu.SLAB_USBtoUART",
        "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0",
        "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0",
    ],
)
def test_serial_ports_of_all_systems_have_an_address(port):
    assert parse_address(f"rtu://{port}?baud=9600").path == port
    assert port_path(f"serial://{port}") == port
    NodeAcquisition(address=f"rtu://{port}?baud=9600", sample_period_s=1e-3)


@pytest.mark.parametrize(
    "host", ["bench_7", "my_bench.lab-1.example", "[fd00::7]", "[fe80::1%eth0]", "192.168.0.7"]
)
def test_a_profile_takes_the_hosts_that_an_address_takes(host):
    NodeAcquisition(address=f"tcp://{host}:502", sample_period_s=1e-3)
    found = parse_address(f"tcp://{host}:502")
    assert (found.host, found.port) == (host.strip("[]"), 502)
    assert str(found) == f"tcp://{host}:502"


def test_a_serial_address_has_its_settings():
    found = parse_address("rtu:///dev/ttyUSB0?baud=921600&parity=none&stop=2&gap_us=1750")
    assert (found.path, str(found)) == ("/dev/ttyUSB0", "rtu:///dev/ttyUSB0")
    line = found.serial
    assert (line.baud_bd, line.parity, line.stop_bits, line.gap_s) == (921600, "N", 2, 1.75e-3)
    # start, eight data, two stop bits; with parity and one stop bit the same eleven
    assert line.character_s == pytest.approx(11 / 921600)
