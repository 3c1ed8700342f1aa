"""Faults of the answers: refusals of every code, counters that wrap at any place of a block."""

from __future__ import annotations

import random
import time
from pathlib import Path

import numpy as np

from faults import polled, replies
from faults.kit import Row
from faults.lines import emulated
from faults.polled import TABLE, CountingDevice
from hdbench.devices.daq import DaqSettings
from hdbench.devices.emulator.machine import BlockHeader, encode_block, encode_scans, seal_block
from hdbench.devices.modbus.layout import place_of
from hdbench.devices.modbus.outputs import Outputs
from hdbench.devices.node.blocks import BlockReader
from hdbench.devices.node.registers import block_registers, block_scans
from hdbench.errors import HdbenchError

__all__ = ["refusals", "waits", "wraps"]

DEADLINE_S = 0.3
# deadlines are to be kept within 10 %; the rest is the scheduler of a busy machine
OVER = 1.1


class RefusingDevice(CountingDevice):
    """Refuses the next requests with the codes that it is told, and counts what it was asked."""

    def __init__(self) -> None:
        super().__init__()
        self.codes: list[int] = []
        self.asked: list[int] = []
        # exception 5 says that the request was taken: it is carried out all the same
        self.done_after = 0

    def answer(self, pdu: bytes, *numbers: int) -> bytes | None:
        """Answer one request."""
        self.asked.append(pdu[0])
        if not self.codes:
            return super().answer(pdu, *numbers)
        code = self.codes.pop(0)
        if code == 5:
            super().answer(pdu, *numbers)
        return bytes((pdu[0] | 0x80, code))


def _tried(wire: str, trials: int, seed: int, row: Row, choose, judge) -> None:
    """Let a device refuse reads and writes, and judge what the driver makes of each."""
    chance, device = random.Random(seed), RefusingDevice()
    places = [place_of(TABLE, channel) for channel in TABLE.channels]
    if TABLE.output is None:
        raise ValueError("the table has no output")
    with emulated(device, wire) as address:
        access = polled.reached(address, DEADLINE_S)
        outputs = Outputs(access, TABLE, TABLE.output)
        access.read(places)
        for number in range(trials):
            write = chance.random() < 0.5
            device.codes, device.asked = choose(chance, write), []
            told = tuple(device.codes)
            value, error, found = (number % 2001 - 1000) * 1e-3, None, None
            start_s = time.monotonic()
            try:
                found = outputs.write(value) if write else access.read(places)
            except HdbenchError as raised:
                error = raised
            took_s = time.monotonic() - start_s
            if isinstance(found, float) and abs(found - value) > 1e-3:
                row.add(f"wrote {value}, read {found}")
                continue
            row.add(judge(told, write, device, error, took_s))
            time.sleep(0.0)
            device.codes = []
        access.close()


def refusals(_folder: Path, trials: int, seed: int) -> Row:
    """Exceptions 1, 2 and 3: the profile is wrong; no second try, and the register is named."""
    row = Row("16", "exceptions 1, 2 and 3 of a polled device, reads and writes")

    def choose(chance: random.Random, _write: bool) -> list[int]:
        return [chance.choice((1, 2, 3))]

    def judge(told, write, device, error, _took_s) -> str:
        if error is None or error.exit_code != 4:
            return f"exception {told}: {error}"
        if len(device.asked) != 1:
            return f"exception {told}: {len(device.asked)} requests"
        name = "200" if write else "100"
        return "" if name in error.where else f"exception {told}: the place is {error.where}"

    for wire in ("tcp", "rtu"):
        _tried(wire, max(2, trials // 2), seed, row, choose, judge)
    row.notes["exit"] = "4, one request each"
    return row


def waits(_folder: Path, trials: int, seed: int) -> Row:
    """Exception 4 is a failure, 5 and 6 are waited for; a write that was taken is sent once."""
    row = Row("17", "exception 4; 5 and 6 a few times, or for ever")

    def choose(chance: random.Random, _write: bool) -> list[int]:
        kind = chance.randrange(4)
        if kind == 0:
            return [4]
        if kind == 1:
            # more than fit the deadline of every call, the read-back's included
            return [6] * 200
        return [chance.choice((5, 6))] * chance.randint(1, 3)

    def judge(told, write, device, error, took_s) -> str:
        allowed_s = OVER * DEADLINE_S * (8 if write else 1)
        if took_s > allowed_s:
            row.count("calls over the deadline")
        if told == (4,):
            row.count("exception 4: exit 5")
            return "" if error is not None and error.exit_code == 5 else f"4: {error}"
        if len(told) > 3:
            row.count("busy for ever: exit 5")
            return "" if error is not None and error.exit_code == 5 else f"for ever: {error}"
        writes = sum(code == 6 for code in device.asked)
        refused = sum(code == 6 for code in told)
        if write and writes > 1 + refused:
            return f"{told}: written {writes} times"
        row.count("waited for: right answer")
        return "" if error is None else f"{told}: {error.what}"

    _tried("tcp", trials, seed, row, choose, judge)
    return row


def wraps(_folder: Path, trials: int, seed: int) -> Row:
    """Counters that wrap at every place of a block: encoder (16 and 32 bit), block numbers."""
    row = Row(
        "22", "wraps of the encoder (2^16, 2^32) and of the block number, anywhere in a block"
    )
    chance = random.Random(seed)
    limits = {
        "range_v": 10.0, "current_range_a": 10.0, "converter_bits": 16,
        "limit_velocity_rad_s": 400.0, "encoder_counts_per_turn": 4000,
    }  # fmt: skip
    settings = DaqSettings(replies.ROLES, 1e-3, 2**31, 0.5)
    n = block_scans(5)
    for number in range(trials):
        # the wrap stands at this scan of the block, for every scan in turn
        edge = (2**31, 2**15, -(2**31), -(2**15), 2**16, -(2**16))[number // n % 6]
        step = chance.choice((1, 7, 250, -1, -7, -250))
        first = edge - step * (number % n)
        counts = first + step * np.arange(2 * n)
        reader = BlockReader(limits, settings, run=1, where="node")
        reader.ack = seq = 65535 - (number % 2)
        codes = np.zeros((n, 4), dtype=np.int16)
        got = []
        for part in range(2):
            seq = seq % 65535 + 1
            header = BlockHeader(1, seq, 2, 0, part * n, 0x2F)
            scans = encode_scans(codes, counts[part * n : (part + 1) * n])
            raw = seal_block(encode_block(header, scans), 0)[: 2 * block_registers(5)]
            block = reader.take(raw, (0.0, 0.0))
            if block is not None:
                got.append(block.values[:, -1])
        # the node's counter has 32 bits: steps between samples tell, modulo 2^32
        steps = np.diff(np.concatenate(got)) if len(got) == 2 else np.zeros(1)
        exact = bool(np.all((steps - step) % 2**32 == 0.0)) and got[0][0] % 2**32 == first % 2**32
        row.add("" if exact else f"edge {edge}, step {step}: {steps}")
    return row
