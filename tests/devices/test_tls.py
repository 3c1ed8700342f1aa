"""Modbus inside TLS: both sides show a certificate, and nothing passes without."""

import shutil
import socket
import ssl
import subprocess
import time
from contextlib import closing
from functools import partial

import pytest
from nodekit import adu, rogue
from stopwatch import SLACK_S, fails

from hdbench.devices.modbus.replies import polled_link
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import FrameError, connect, read_registers
from hdbench.errors import UsageError
from hdbench.profile.acquiring import TlsFiles

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="makes certificates")


def _openssl(folder, command):
    subprocess.run(["openssl", *command.split()], cwd=folder, check=True, capture_output=True)


def _request(name):
    curve = "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes"
    return f"req {curve} -keyout {name}.key -subj /CN={name}"


def _certificate(folder, name, authority, host):
    _openssl(folder, f"{_request(name)} -out {name}.csr")
    (folder / f"{name}.ext").write_text(f"subjectAltName={host}\n")
    signed = f"-CA {authority}.pem -CAkey {authority}.key -CAcreateserial -extfile {name}.ext"
    _openssl(folder, f"x509 -req -in {name}.csr {signed} -out {name}.pem -days 2")
    (folder / f"{name}.key").chmod(0o600)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certificates")
    for name in ("ours", "stranger"):
        _openssl(folder, f"{_request(name)} -x509 -out {name}.pem -days 2")
    _certificate(folder, "node", "ours", "IP:127.0.0.1,DNS:bench-7")
    _certificate(folder, "elsewhere", "ours", "DNS:bench-8")
    _certificate(folder, "host", "ours", "DNS:host")
    _certificate(folder, "intruder", "stranger", "DNS:host")
    return folder


def _node(folder, certificate="node"):
    """Answer reads inside TLS; asks for the host's certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / f"{certificate}.pem", folder / f"{certificate}.key")
    context.load_verify_locations(folder / "ours.pem")
    context.verify_mode = ssl.CERT_REQUIRED
    return rogue(
        lambda connection, frame: connection.sendall(adu(frame, bytes((3, 4, 0, 17, 34, 51)))),
        partial(context.wrap_socket, server_side=True),
    )


def _files(folder, *, host="host", authority="ours", server_name=None):
    return TlsFiles(
        certificate=str(folder / f"{host}.pem"),
        key=str(folder / f"{host}.key"),
        authority=str(folder / f"{authority}.pem"),
        server_name=server_name,
    )


def _read(port, files, deadline_s=2.0, make=connect):
    link = make(parse_address(f"tls://127.0.0.1:{port}"), tls=files)
    with closing(link):
        return link.transact(*read_registers(0x0100, 2), time.monotonic() + deadline_s)


@pytest.mark.parametrize("make", [connect, polled_link])
@pytest.mark.parametrize("server_name", [None, "bench-7"])
def test_a_read_passes_where_both_certificates_are_signed(folder, server_name, make):
    with _node(folder) as (_, port, requests):
        files = _files(folder, server_name=server_name)
        assert _read(port, files, make=make)[2:] == b"\x00\x11\x22\x33"
    assert len(requests) == 1


@pytest.mark.parametrize(
    ("certificate", "files"),
    [
        ("node", {"authority": "stranger"}),
        ("elsewhere", {}),
        ("node", {"server_name": "bench-8"}),
        ("node", {"host": "intruder"}),
    ],
    ids=["unknown authority", "another host's certificate", "another name", "stranger as host"],
)
@pytest.mark.parametrize("make", [connect, polled_link])
def test_nothing_is_asked_of_a_device_that_cannot_be_trusted(folder, certificate, files, make):
    with (
        _node(folder, certificate) as (_, port, requests),
        pytest.raises(FrameError, match=r"no secure connection|closed|no connection|reset"),
    ):
        _read(port, _files(folder, **files), make=make)
    assert not requests


def test_a_plain_modbus_server_is_no_secure_one(folder):
    refusal = bytes.fromhex("0001 0000 0003 01 83 01")  # whatever the greeting is taken for
    with (
        rogue(lambda connection, frame: connection.sendall(refusal)) as (_, port, _),
        fails(FrameError, within_s=5.0),
    ):
        _read(port, _files(folder), deadline_s=0.5)


def test_a_silent_server_does_not_hold_the_handshake_beyond_the_deadline(folder):
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        # 10 %, and what the scheduler may add
        fails(FrameError, within_s=0.22 + SLACK_S),
    ):
        _read(listener.getsockname()[1], _files(folder), deadline_s=0.2)


def test_without_certificates_there_is_no_secure_address():
    with pytest.raises(UsageError, match="certificates"):
        connect(parse_address("tls://127.0.0.1:802"))


def test_a_key_that_others_may_read_is_refused(folder, tmp_path):
    key = tmp_path / "open.key"
    key.write_bytes((folder / "host.key").read_bytes())
    key.chmod(0o644)
    files = _files(folder).model_copy(update={"key": str(key)})
    with pytest.raises(UsageError, match="0644") as caught:
        connect(parse_address("tls://127.0.0.1:802"), tls=files)
    assert caught.value.fix == f"chmod 600 {key}"


@pytest.mark.parametrize("name", ["certificate", "authority", "key"])
def test_a_missing_file_is_named_by_its_key(folder, name):
    files = _files(folder).model_copy(update={name: str(folder / "none.pem")})
    with pytest.raises(UsageError) as caught:
        connect(parse_address("tls://127.0.0.1:802"), tls=files)
    assert caught.value.where == f"key daq.tls.{name}"
