"""Names of hosts: asked for once, before anything moves."""

import socket
import time

import pytest
from changing import with_keys
from nodekit import realtime_emulator
from served import WAVE, read_samples
from stopwatch import fails

from hdbench.devices import AcquisitionSettings, open_bench, opening, stop_bench
from hdbench.devices.guard.order import order_of
from hdbench.devices.wire import address
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import FrameError, connect, read_registers
from hdbench.errors import DeviceError
from hdbench.profile import load_profile
from hdbench.profile.acquiring import TlsFiles


class Resolver:
    """Knows one name, after a while, and counts how often it is asked for it."""

    def __init__(self, number="127.0.0.1", slow_s=0.0):
        self.asked = 0
        self.number = number
        self.slow_s = slow_s
        self.ask = socket.getaddrinfo

    def __call__(self, host, port, *args, **keys):
        if host != "bench-7":
            return self.ask(host, port, *args, **keys)
        if keys.get("flags", 0) & socket.AI_NUMERICHOST:
            raise socket.gaierror(socket.EAI_NONAME, "not a number")
        self.asked += 1
        time.sleep(self.slow_s)
        return self.ask(self.number, port, *args, **keys)


def named(data, found):
    """Return a profile at an emulator, what is on the network by its name."""
    there = opening._at(data, found)
    driving = getattr(there.daq, "outputs", there.daq)
    table = driving.model_copy(update={"address": driving.address.replace("127.0.0.1", "bench-7")})
    if driving is not there.daq:
        # an emulator on a busy machine may take its time
        inputs = there.daq.inputs.model_copy(update={"deadline_s": 0.9})
        table = there.daq.model_copy(update={"outputs": table, "inputs": inputs})
    return there.model_copy(update={"daq": table})


def link_of(daq):
    """Return the connection that carries a driver's requests."""
    daq = getattr(daq, "_outputs", daq) if hasattr(daq, "_inputs") else daq
    for name in ("node", "control", "_access"):
        if hasattr(daq, name):
            return getattr(daq, name)._link
    raise AssertionError(f"{type(daq).__name__}: {sorted(vars(daq))}")


@pytest.mark.parametrize("name", ["cim-tr-97-06", "labjack-t7", "di-2108-ek9000"])
def test_a_run_asks_for_the_name_once(name, monkeypatch):
    data = load_profile(name).data
    resolver = Resolver()
    with realtime_emulator(data) as found:
        monkeypatch.setattr(socket, "getaddrinfo", resolver)
        with open_bench(named(data, found)) as bench:
            bench.configure(AcquisitionSettings(4e-3, 100_000, WAVE))
            link_of(bench.daq).close()
            bench.start()
            read_samples(bench, 200)
            bench.stop()
            link_of(bench.daq).close()
            safe = bench.safe_state()
    assert safe.confirmed, safe.detail
    assert resolver.asked == 1


def test_the_guard_and_other_children_get_numbers_and_tls_keeps_its_name(monkeypatch):
    monkeypatch.setattr(socket, "getaddrinfo", Resolver("192.0.2.7"))
    files = TlsFiles(certificate="c", key="k", authority="a")
    data = load_profile("cim-tr-97-06").data
    data = with_keys(data, daq={"address": "tls://bench-7:802", "tls": files})
    (target,) = order_of(opening._numbered(data)).targets
    assert target.place["host"] == "192.0.2.7"
    assert target.place["tls"]["server_name"] == "bench-7"


def test_a_connection_asks_nobody_for_a_name(monkeypatch):
    monkeypatch.setattr(socket, "getaddrinfo", resolver := Resolver())
    link = connect(parse_address("tcp://bench-7:502"))
    with pytest.raises(FrameError, match="not a number"):
        link.transact(*read_registers(0, 1), time.monotonic() + 1.0)
    assert resolver.asked == 0


def test_a_resolver_that_does_not_answer_is_told_before_anything_is_opened(monkeypatch):
    monkeypatch.setattr(socket, "getaddrinfo", Resolver(slow_s=1.0))
    monkeypatch.setattr(address, "_LONGEST_S", 0.3)
    with fails(DeviceError, r"bench-7.*0\.3 s", within_s=1.0) as caught:
        stop_bench(load_profile("cim-tr-97-06"), address="tcp://bench-7:502")
    assert "number" in caught.value.fix


def test_a_name_that_nobody_knows_is_a_device_error(monkeypatch):
    def unknown(host, *_, **__):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with (
        pytest.raises(DeviceError, match=r"'bench-7'.*not known"),
        open_bench(load_profile("cim-tr-97-06"), address="tcp://bench-7:502"),
    ):
        pass


def test_of_several_numbers_the_one_that_answers_is_taken(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        ask = socket.getaddrinfo

        def both(host, port, **keys):
            hosts = ("127.0.0.9", "127.0.0.1") if host == "bench-7" else (host,)
            return [place for one in hosts for place in ask(one, port, **keys)]

        monkeypatch.setattr(socket, "getaddrinfo", both)
        assert address.numbered(f"tcp://bench-7:{port}") == f"tcp://127.0.0.1:{port}"


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("tcp://192.0.2.7:502", "tcp://192.0.2.7:502"),
        ("tcp://192.0.2.7", "tcp://192.0.2.7"),
        ("tcp://[2001:DB8:0::7]:502", "tcp://[2001:db8::7]:502"),
        ("tcp://[::ffff:192.0.2.7]:502", "tcp://192.0.2.7:502"),
        ("tls://[fe80::1%eth0]:802", "tls://[fe80::1%eth0]:802"),
        ("rtu:///dev/ttyUSB0?baud=9600", "rtu:///dev/ttyUSB0?baud=9600"),
        ("embedded", "embedded"),
        # what is no address is for the driver to refuse
        ("tcp://a b:502", "tcp://a b:502"),
        ("acme://bench-7", "acme://bench-7"),
    ],
)
def test_numbers_and_other_addresses_are_asked_for_nowhere(text, number, monkeypatch):
    monkeypatch.delattr(socket, "getaddrinfo")
    assert address.numbered(text) == number
