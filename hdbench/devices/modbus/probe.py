"""The who-are-you read that tells, after a fault on a serial line, a late reply from a new one."""

from __future__ import annotations

from hdbench.devices.modbus.layout import Block, place_of, plan_blocks
from hdbench.devices.modbus.rules import fits
from hdbench.devices.modbus.values import decode
from hdbench.devices.wire import FrameError, Probe, ReplyCheck
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusIdentify

__all__ = ["make_probe"]


def make_probe(table: ModbusAcquisition) -> Probe | None:
    """Return the probe of a device; None where the profile gives nothing to tell replies apart.

    Notes
    -----
    Best is a read of a length that no other read has: part of a block of registers that is polled
    anyhow. Where every block is too short for that, a register of `identify` is read whose value
    is known; a late reply would have to carry that very value.
    """
    lengths = _odd_lengths(table)
    known = [rule for rule in table.identify if rule.equals is not None and _is_register(rule)]
    if not lengths and not known:
        return None

    def probe(number: int) -> tuple[bytes, ReplyCheck]:
        if lengths:
            return lengths[number % len(lengths)].request()
        return _known(table, known[number % len(known)])

    return probe


def _odd_lengths(table: ModbusAcquisition) -> list[Block]:
    """Return reads of registers that exist, each of a length that no regular read has."""
    polled = [place_of(table, channel) for channel in table.channels]
    single = [place_of(table, rule) for rule in table.identify]
    blocks = plan_blocks(
        [*polled, *single], most=table.max_read_registers, bridge=table.bridge_registers
    )
    # any value may be read alone, and every run of channels as one block: these lengths are usual
    usual = {place.size for place in (*polled, *single)} | {block.size for block in blocks}
    usual |= {
        block.size
        for count in range(1, len(polled) + 1)
        for block in plan_blocks(
            polled[:count], most=table.max_read_registers, bridge=table.bridge_registers
        )
    }
    largest = max(
        (block for block in blocks if block.space in ("holding", "input")),
        key=lambda block: block.size,
        default=None,
    )
    if largest is None:
        return []
    return [
        Block(largest.space, largest.start, size, largest.name)
        for size in range(1, largest.size)
        if size not in usual
    ]


def _is_register(rule: ModbusIdentify) -> bool:
    return rule.table in ("holding", "input")


def _known(table: ModbusAcquisition, rule: ModbusIdentify) -> tuple[bytes, ReplyCheck]:
    place = place_of(table, rule)
    request, size_check = Block(place.space, place.start, place.size, place.name).request()

    def check(pdu: bytes) -> None:
        size_check(pdu)
        if not fits(rule, decode(pdu[2:], place.kind, place.order)):
            raise FrameError("a reply to an earlier request")

    return request, check
