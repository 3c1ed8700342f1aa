"""The driver's register map against LabJack's own list, and the emulator against other clients."""

import socket
import struct
import time
from functools import partial

import numpy as np
import pytest
from labjackkit import served
from pymodbus.client import ModbusTcpClient

from hdbench.devices.wire.link import ExceptionReply, FrameError
from hdbench.drivers.labjack import registers as reg
from hdbench.drivers.labjack.control import feedback_request

# name, address, type and access as ljm_constants.json (LabJack Corporation, 2025.12.18.A) has them
PUBLISHED = """
TEST 55100 u32 R
PRODUCT_ID 60000 f32 R
FIRMWARE_VERSION 60004 f32 R
SERIAL_NUMBER 60028 u32 R
LAST_ERR_DETAIL 55000 u16 R
LAST_ERR_TRANSACTION_ID 55003 u16 R
CORE_TIMER 61520 u32 R
STREAM_SCANRATE_HZ 4002 f32 RW
STREAM_NUM_ADDRESSES 4004 u32 RW
STREAM_SAMPLES_PER_PACKET 4006 u32 RW
STREAM_SETTLING_US 4008 f32 RW
STREAM_RESOLUTION_INDEX 4010 u32 RW
STREAM_BUFFER_SIZE_BYTES 4012 u32 RW
STREAM_AUTO_TARGET 4016 u32 RW
STREAM_NUM_SCANS 4020 u32 RW
STREAM_AUTORECOVER_DISABLE 4028 u32 RW
STREAM_ENABLE 4990 u32 RW
DIO_STATE 2800 u32 RW
INTERNAL_FLASH_READ_POINTER 61810 u32 RW
WATCHDOG_ENABLE_DEFAULT 61600 u32 RW
WATCHDOG_ADVANCED_DEFAULT 61602 u32 RW
WATCHDOG_TIMEOUT_S_DEFAULT 61604 u32 RW
WATCHDOG_STARTUP_DELAY_S_DEFAULT 61606 u32 RW
WATCHDOG_STRICT_ENABLE_DEFAULT 61610 u32 RW
WATCHDOG_STRICT_KEY_DEFAULT 61612 u32 RW
WATCHDOG_STRICT_CLEAR 61614 u32 W
WATCHDOG_RESET_ENABLE_DEFAULT 61620 u32 RW
WATCHDOG_DIO_ENABLE_DEFAULT 61630 u32 RW
WATCHDOG_DIO_STATE_DEFAULT 61632 u32 RW
WATCHDOG_DIO_DIRECTION_DEFAULT 61634 u32 RW
WATCHDOG_DIO_INHIBIT_DEFAULT 61636 u32 RW
WATCHDOG_DAC0_ENABLE_DEFAULT 61640 u32 RW
WATCHDOG_DAC0_DEFAULT 61642 f32 RW
WATCHDOG_DAC1_ENABLE_DEFAULT 61650 u32 RW
WATCHDOG_DAC1_DEFAULT 61652 f32 RW
USER_RAM0_U32 46100 u32 RW
USER_RAM1_U32 46102 u32 RW
AIN13 26 f32 R
AIN13_RANGE 40026 f32 RW
AIN13_NEGATIVE_CH 41013 u16 RW
DAC1 1002 f32 RW
TDAC7 30014 f32 W
DIO5_EF_ENABLE 44010 u32 RW
DIO5_EF_INDEX 44110 u32 RW
STREAM_SCANLIST_ADDRESS127 4354 u32 RW
"""


def test_names_addresses_types_and_access_are_labjacks():
    made = (
        *(reg.analog_input(13), reg.analog_range(13), reg.negative_channel(13)),
        *(reg.dac(1), reg.tick_dac(7), reg.ef_enable(5), reg.ef_index(5), reg.scan_list(127)),
    )
    by_name = reg.BY_NAME | {register.name: register for register in made}
    for line in PUBLISHED.split("\n")[1:-1]:
        name, address, kind, access = line.split()
        register = by_name[name]
        assert (register.address, register.kind) == (int(address), kind), name
        assert not register.writable or "W" in access, name
    assert (reg.FIO_EIO_STATE, reg.STREAM_CAPTURE_16, reg.FLASH_READ) == (2580, 4899, 61812)


def test_function_76_is_what_labjack_describes():
    request, check = feedback_request(((reg.dac(0), 2.5),), (reg.DIO_STATE, reg.digital_line(4)))
    written = b"\x01\x03\xe8\x02" + struct.pack(">f", 2.5)
    assert request == b"\x4c" + written + b"\x00\x0a\xf0\x02" + b"\x00\x07\xd4\x01"
    check(b"\x4c" + bytes(6))
    for wrong in (b"\x4c" + bytes(5), b"\x4c" + bytes(7), b"\x4d" + bytes(6), b"", b"\xcc"):
        with pytest.raises(FrameError):
            check(wrong)
    with pytest.raises(ExceptionReply):
        check(b"\xcc\x04")
    with pytest.raises(ValueError, match="not written"):
        feedback_request(((reg.TEST, 1.0),), ())


def connected(device):
    return ModbusTcpClient(device.host, port=device.port, timeout=60, retries=0)


def test_another_librarys_client_reads_and_writes_the_emulated_device():
    with served(seed=41) as device, connected(device) as client:
        read = partial(client.read_holding_registers, count=2, device_id=1)
        # product 7.0 and reference -4.5 as 32-bit floats
        assert read(55100).registers == [0x0011, 0x2233]
        assert read(60028).registers == [0, 41]
        assert read(60000).registers == [0x40E0, 0]
        assert not client.write_registers(30004, [0xC090, 0], device_id=1).isError()
        assert device.instrument.reference_v == -4.5
        assert not client.write_register(2004, 1, device_id=1).isError()
        assert device.instrument.enabled
        for address in (9, 30004, 70):
            assert read(address).exception_code == 2, address
        assert client.write_registers(4990, [0, 0], device_id=1).exception_code == 4
        assert read(55000, count=1).registers == [2620]


def test_a_reader_written_from_labjacks_description_understands_the_stream():
    with served() as device, connected(device) as client:

        def write(address: int, *values: tuple[str, float]) -> None:
            raw = b"".join(struct.pack(">" + kind, value) for kind, value in values)
            registers = list(struct.unpack(f">{len(raw) // 2}H", raw))
            assert not client.write_registers(address, registers, device_id=1).isError()

        # 500 Hz, AIN3 (the looped-back reference) and the core timer, 30 samples a packet
        write(4002, ("f", 500.0), ("I", 3), ("I", 30), ("f", 0.0), ("I", 0), ("I", 0))
        write(4016, ("I", 1), ("I", 0), ("I", 0))
        write(4100, ("I", 6), ("I", 61520), ("I", 4899))
        write(30004, ("f", 1.25))
        with socket.create_connection((device.host, device.port + 200), timeout=60) as stream:
            time.sleep(0.05)
            write(4990, ("I", 1))
            scans = []
            for expected in range(6):
                packet = stream.recv(76, socket.MSG_WAITALL)
                head = struct.unpack(">HHHBBBBHHH", packet[:16])
                assert head[:6] == (expected, 0, 70, 1, 76, 16)
                assert head[8:] == (0, 0)
                scans.append(np.frombuffer(packet[16:], ">u2").reshape(10, 3))
    words = np.concatenate(scans).astype(np.int64)
    ticks = words[:, 1] + (words[:, 2] << 16)
    # 40 MHz at 500 Hz
    assert np.all(np.diff(ticks) % 2**32 == 80_000)
    # nominal constants: 33523 is 0 V, 3.158e-4 V a word; this device is within 0.2 % of them
    volts = (words[:, 0] - 33523) * 3.1580578e-4
    assert volts == pytest.approx(1.25, rel=3e-3)
