"""Faults on the wire do what their names say, and nothing else."""

import os
import socket
import struct
import time

from faults.lines import faulty_serial, faulty_tcp
from faults.mangler import Mangler, RawFraming, RtuFraming, TcpFraming
from nodekit import rogue

from hdbench.devices.wire.rtu import crc16
from hdbench.system.lines import terminal_pair

# a reply with two registers, an echo of a write, and one of function 76
READ = struct.pack(">HHHB", 7, 0, 7, 1) + bytes((3, 4, 0, 17, 34, 51))
ECHO = struct.pack(">HHHB", 8, 0, 6, 1) + bytes((16, 0, 5, 0, 2))
FEEDBACK = struct.pack(">HHHB", 9, 0, 6, 1) + bytes((76, 0, 17, 34, 51))


def mangled(kind: str, frame: bytes = READ, **options: float) -> list:
    return Mangler(kind, TcpFraming(), **options)(frame)


def data_of(kind: str, frame: bytes = READ, seed: int = 1) -> bytes:
    (delivery,) = mangled(kind, frame, seed=seed)
    return delivery.data


def test_frames_are_found_however_the_bytes_arrive():
    buffer, found = bytearray(), []
    for byte in READ + ECHO + FEEDBACK:
        buffer.append(byte)
        found += TcpFraming().split(buffer)
    assert found == [READ, ECHO, FEEDBACK]
    bodies = (b"\x01" + READ[7:], b"\x01\x06\0\1\0\2", b"\x01\x83\2")
    frames = [body + crc16(body) for body in bodies]
    buffer = bytearray(b"".join(frames) + b"\1")
    assert RtuFraming(crc16).split(buffer) == frames
    assert buffer == b"\1"


def test_timing_faults_keep_the_bytes():
    assert mangled("drop") == []
    (late,) = mangled("late", late_s=0.3)
    assert (late.data, late.after_s) == (READ, 0.3)
    assert [d.data for d in mangled("duplicate")] == [READ, READ]
    (slow,) = mangled("slow-loris", late_s=0.9)
    assert (slow.data, slow.per_byte_s) == (READ, 0.9)
    mangler = Mangler("reorder", TcpFraming())
    assert mangler(READ) == []
    assert [d.data for d in mangler(ECHO)] == [ECHO, READ]
    mangler = Mangler("stale", TcpFraming(), skip=1)
    mangler(READ)
    assert [d.data for d in mangler(ECHO)] == [READ]


def test_wrong_replies_are_well_formed_and_wrong_in_one_thing():
    for seed in range(20):
        frame = data_of("count", seed=seed)
        assert frame[4:6] == struct.pack(">H", len(frame) - 6)
        assert frame[8] == len(frame) - 9 != 4
        assert data_of("function", seed=seed)[7] != 3
        assert data_of("function", seed=seed)[8:] == READ[8:]
        refusal = data_of("exception", seed=seed)
        assert refusal[7] == 0x83
        assert 1 <= refusal[8] <= 6
        assert data_of("echo", ECHO, seed=seed)[:8] == ECHO[:8]
        assert data_of("echo", ECHO, seed=seed) != ECHO
        header = data_of("transaction", seed=seed)
        assert header[:2] != READ[:2]
        assert header[2:] == READ[2:]
    assert data_of("word-swap")[9:] == bytes((34, 51, 0, 17))
    assert data_of("word-swap", FEEDBACK)[8:] == bytes((34, 51, 0, 17))
    assert data_of("unit")[6] != READ[6]


def test_a_wrong_serial_reply_has_a_right_checksum_and_noise_has_not():
    body = b"\x01" + READ[7:]
    frame = body + crc16(body)
    for kind in ("unit", "function", "count", "exception", "word-swap"):
        (delivery,) = Mangler(kind, RtuFraming(crc16), seed=4)(frame)
        assert crc16(delivery.data[:-2]) == delivery.data[-2:]
        assert delivery.data != frame
    (delivery,) = Mangler("mutate", RtuFraming(crc16), seed=4)(frame)
    assert crc16(delivery.data[:-2]) != delivery.data[-2:]


def test_noise_flips_bits_at_its_rate():
    mangler = Mangler("noise", RawFraming(), seed=2, bit_rate=0.01)
    flipped = sum(
        (a ^ b).bit_count()
        for _ in range(50)
        for a, b in zip(mangler(bytes(1000))[0].data, bytes(1000), strict=True)
    )
    # 400 000 bits at 1 %: 4000, standard deviation 63; five of them
    assert abs(flipped - 4000) < 315


def test_a_share_of_the_frames_is_changed_and_counted():
    mangler = Mangler("drop", TcpFraming(), share=0.2, seed=3, skip=100)
    gone = [not mangler(READ) for _ in range(2100)]
    assert not any(gone[:100])
    assert mangler.seen == 2100
    assert mangler.changed == sum(gone)
    # 2000 frames at 20 %: 400, standard deviation 18; five of them
    assert abs(sum(gone) - 400) < 90


def _asked(address: tuple[str, int], count: int = 1) -> bytes:
    with socket.create_connection(address, timeout=2.0) as host:
        host.sendall(READ * count)
        data = b""
        try:
            while len(data) < count * len(READ) and (chunk := host.recv(4096)):
                data += chunk
        except OSError as error:
            return data + type(error).__name__.encode()
        return data


def test_on_tcp_the_host_sees_the_fault():
    with rogue(lambda connection, frame: connection.sendall(frame)) as (*echo_server, _):
        with faulty_tcp(*echo_server, Mangler("duplicate", TcpFraming())) as near:
            assert _asked(near, 2)[: 2 * len(READ)] == READ * 2
        # a busy machine may add to it, never take from it
        for kind, late_s, least_s in (("late", 0.2, 0.2), ("slow-loris", 0.01, 0.01 * len(READ))):
            with faulty_tcp(*echo_server, Mangler(kind, TcpFraming(), late_s=late_s)) as near:
                start_s = time.monotonic()
                assert _asked(near) == READ
                assert time.monotonic() - start_s >= least_s
        for kind, told in (("fin", b""), ("reset", b"ConnectionResetError")):
            with faulty_tcp(*echo_server, Mangler(kind, TcpFraming())) as near:
                assert _asked(near) == told


def test_on_a_serial_line_the_host_sees_the_fault():
    device, terminal, far = terminal_pair(blocking=True)
    with faulty_serial(far, Mangler("mutate", RawFraming(), seed=1)) as path:
        host = os.open(path, os.O_RDWR | os.O_NOCTTY)
        os.write(host, b"who are you")
        assert os.read(device, 100) == b"who are you", "requests pass as they are"
        os.write(device, bytes(8))
        reply = os.read(host, 100)
        os.close(host)
    assert sum(byte.bit_count() for byte in reply) == 1
    os.close(device)
    os.close(terminal)
