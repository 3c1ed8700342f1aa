"""Identity of a polled device: checked before any write, and proven again after a fault."""

from __future__ import annotations

from hdbench.devices.bench import Identity
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import Block, blocks_of, fits, needed, place_of, values_of
from hdbench.devices.registers import Order, Register, encode
from hdbench.devices.wire.link import FrameError, Probe, ReplyCheck
from hdbench.errors import DeviceError, ProfileError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusIdentify, places_in

# "HBEM": what stands in registers of the emulator that the profile leaves free, far from the others
SIGNATURE = 0x4842_454D
_HIGHEST, _STEP, _AWAY = 0xFF01, 0x100, 32
_ORDERS: dict[Order, str] = {
    "CDAB": "words swapped",
    "BADC": "bytes swapped",
    "DCBA": "bytes and words swapped",
}


def signature_address(table: ModbusAcquisition) -> int:
    """Return where the emulator's signature stands: the highest place that nothing else takes."""
    taken = [place_of(table, place) for _, place in places_in(table)]
    start = _HIGHEST
    while any(start - 2 * _AWAY < place.address < start + _AWAY for place in taken):
        start -= _STEP
    return start


def is_emulator(access: Access, table: ModbusAcquisition) -> bool:
    """Return whether hdbench's own emulator answers; a real device has nothing there."""
    place = Register("signature", signature_address(table), "u32")
    try:
        return access.read([place])[0] == SIGNATURE
    except (ProfileError, DeviceError):
        # refused, or a device that keeps silent about registers that it does not have
        return False


def check_identity(access: Access, table: ModbusAcquisition) -> Identity:
    """Return who answers, if it is the device that the profile means."""
    places = [place_of(table, rule) for rule in table.identify]
    for rule, place, found in zip(table.identify, places, access.read(places), strict=True):
        if not fits(rule, found):
            raise access.error(
                f"reads {found:.9g}; needed: {needed(rule)}{_hint(rule, found)}",
                place.name,
                "this is another device, or its byte order is another: correct daq.address or "
                "daq.identify, then channels and order",
            )
    access.recognise(*(identity_look(table, rule) for rule in table.identify))
    return Identity(
        vendor=table.vendor,
        model=table.model,
        serial=f"unit {table.unit}",
        firmware="",
        simulated=is_emulator(access, table),
    )


def _hint(rule: ModbusIdentify, found: float | int) -> str:
    """Return which other order of the bytes would read the value that is needed."""
    if rule.equals is None or rule.type in ("i16", "u16") or rule.table in ("coil", "discrete"):
        return ""
    for order, words in _ORDERS.items():
        try:
            same = encode(rule.equals, rule.type, order) == encode(found, rule.type, "ABCD")
            if same and rule.order == "ABCD":
                return f"; it is that value with {words}: order {order}"
        except ValueError:
            return ""
    return ""


def make_probe(table: ModbusAcquisition) -> Probe | None:
    """Return the probe of a device; None where the profile gives nothing to tell replies apart.

    Notes
    -----
    Best is a read of a length that no other read has: part of a block of registers that is polled
    anyhow. Where every block is too short for that, a register of `identify` is read whose value
    is known; a late reply would have to carry that very value.
    """
    reads: list[tuple[bytes, ReplyCheck]] = [block.request() for block in _odd_lengths(table)]
    reads = reads or [
        identity_look(table, rule)
        for rule in table.identify
        if rule.equals is not None and rule.table in ("holding", "input")
    ]
    return (lambda number: reads[number % len(reads)]) if reads else None


def _odd_lengths(table: ModbusAcquisition) -> list[Block]:
    """Return reads of registers that exist, each of a length that no regular read has."""
    polled = [place_of(table, channel) for channel in table.channels]
    single = [place_of(table, rule) for rule in table.identify]
    blocks = blocks_of(table, [*polled, *single])
    # any value may be read alone, and every run of channels as one block: these lengths are usual
    usual = {place.size for place in (*polled, *single)} | {block.size for block in blocks}
    usual |= {
        block.size
        for count in range(1, len(polled) + 1)
        for block in blocks_of(table, polled[:count])
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


def identity_look(table: ModbusAcquisition, rule: ModbusIdentify) -> tuple[bytes, ReplyCheck]:
    """Return the read of one identifying value, whose reply must keep its rule."""
    place = place_of(table, rule)
    block = Block(place.space, place.address, place.size, place.name)
    request, size_check = block.request()

    def check(pdu: bytes) -> None:
        size_check(pdu)
        (found,) = values_of([place], {block: pdu[2:]})
        if not fits(rule, found):
            # on a line without transaction numbers it may be an earlier reply
            raise FrameError(f"another device answers: {place.name} reads {found:.9g}")

    return request, check
