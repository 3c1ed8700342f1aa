"""Rules between the keys of a Modbus table, on what can be read even where other keys are wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from hdbench.profile.conflict import Conflict

__all__ = ["modbus_conflicts", "number_ranges"]

Key = tuple[str | int, ...]

# first number of each table as Modicon's manuals count: five digits for 9999 of them, six for all
_MODICON = {"coil": (1, 1), "discrete": (10001, 100001), "input": (30001, 300001),
            "holding": (40001, 400001)}  # fmt: skip
_SHORT, _ALL = 9999, 65536
_PLACES = ("channels", "identify", "init")
_REGISTERS = {"i16": 1, "u16": 1, "i32": 2, "u32": 2, "f32": 2, "f64": 4}


def modbus_conflicts(table: Mapping[object, object], base: Key) -> Iterator[Conflict]:
    """Yield the conflicts of one ``[daq]`` with driver ``modbus``."""
    for key, place in _places(table, base):
        yield from _place(table, place, key)
    for number, rule in enumerate(_items(table, "identify")):
        yield from _rule(rule, (*base, "identify", number))
    for number, channel in enumerate(_items(table, "channels")):
        yield from _channel(channel, (*base, "channels", number))
    writes = table.get("output") is not None or bool(_items(table, "init"))
    if writes and not _items(table, "identify"):
        yield Conflict(
            (*base, "output" if table.get("output") is not None else "init"),
            "would be written to a device that nothing identifies; needed: [[daq.identify]]",
            "add a register whose value tells this device from others",
        )
    yield from _output(table.get("output"), (*base, "output"))


def number_ranges(numbering: str, table: str) -> tuple[tuple[int, int], ...]:
    """Return first and last number of a table's registers, shorter numbers first."""
    if numbering != "modicon":
        first = 1 if numbering == "one" else 0
        return ((first, first + _ALL - 1),)
    short, long = _MODICON[table]
    if short == long:
        return ((short, short + _ALL - 1),)
    return ((short, short + _SHORT - 1), (long, long + _ALL - 1))


def _items(table: Mapping[object, object], name: str) -> list[Mapping[object, object]]:
    found = table.get(name)
    if not isinstance(found, list | tuple):
        return []
    return [item for item in found if isinstance(item, Mapping)]


def _places(
    table: Mapping[object, object], base: Key
) -> Iterator[tuple[Key, Mapping[object, object]]]:
    """Yield every place that the table names, with its key."""
    for name in _PLACES:
        for number, item in enumerate(_items(table, name)):
            yield from _below((*base, name, number), item)
    output = table.get("output")
    if isinstance(output, Mapping):
        yield from _below((*base, "output"), output)


def _below(
    key: Key, item: Mapping[object, object]
) -> Iterator[tuple[Key, Mapping[object, object]]]:
    if "address" in item:
        yield key, item
    for name, value in item.items():
        if isinstance(value, Mapping):
            yield from _below((*key, str(name)), value)
        elif isinstance(value, list | tuple):
            for number, part in enumerate(value):
                if isinstance(part, Mapping):
                    yield from _below((*key, str(name), number), part)


def _place(
    table: Mapping[object, object], place: Mapping[object, object], key: Key
) -> Iterator[Conflict]:
    address, numbering = place.get("address"), table.get("numbering", "zero")
    kind = place.get("table", "coil" if key[-1] == "enable" else "holding")
    if not isinstance(address, int) or isinstance(address, bool) or kind not in _MODICON:
        return
    ends = number_ranges(str(numbering), str(kind))
    if not any(low <= address <= high for low, high in ends):
        words = " or ".join(f"{low} to {high}" for low, high in ends)
        yield Conflict(
            (*key, "address"),
            f"is {address}; needed for numbering {numbering!r}, table {kind!r}: {words}",
            "count as the device's manual does, and say so in daq.numbering",
        )
    if place.get("function") == 6 and _REGISTERS.get(str(place.get("type", "i16")), 1) > 1:
        yield Conflict(
            (*key, "function"), "is 6, which writes one register; needed: 16", "take it out"
        )
    size, most = _REGISTERS.get(str(place.get("type", "i16")), 1), table.get("max_read_registers")
    if kind in ("holding", "input") and isinstance(most, int) and size > most:
        yield Conflict(
            (*key, "type"),
            f"takes {size} registers; one request reads {most} (daq.max_read_registers)",
            "a value must come in one request: raise the limit, or name a shorter type",
        )


def _rule(rule: Mapping[object, object], key: Key) -> Iterator[Conflict]:
    if all(rule.get(name) is None for name in ("equals", "low", "high")):
        yield Conflict(
            key, "says not what it must read; needed: equals, or low and high", "add equals"
        )


def _channel(channel: Mapping[object, object], key: Key) -> Iterator[Conflict]:
    role, bits = channel.get("role"), channel.get("wrap_bits")
    if bits is not None and role != "encoder":
        yield Conflict(
            (*key, "wrap_bits"), "is for an encoder only", "take it out, or correct the role"
        )
    plain = channel.get("scale", 1.0) == 1.0 and channel.get("offset", 0.0) == 0.0
    if role == "encoder" and not (plain and str(channel.get("type", "i16"))[0] in "iu"):
        yield Conflict(
            (*key, "scale"),
            "an encoder is polled in counts: a whole-number type, scale 1, offset 0",
            "scale it by encoder.counts_per_turn instead",
        )
    if channel.get("scale") == 0.0:
        yield Conflict((*key, "scale"), "is 0; needed: another number", "give units per step")


def _output(output: object, key: Key) -> Iterator[Conflict]:
    if not isinstance(output, Mapping):
        return
    if output.get("scale") == 0.0:
        yield Conflict((*key, "scale"), "is 0; needed: V per step", "give V per step")
    enable = output.get("enable")
    if isinstance(enable, Mapping) and enable.get("on", 1) == enable.get("off", 0):
        yield Conflict(
            (*key, "enable", "off"), "is the same as on", "give the value that disables the drive"
        )
    watchdog = output.get("watchdog")
    if not isinstance(watchdog, Mapping):
        return
    if watchdog.get("fed_by") in ("write", "key") and watchdog.get("feed") is None:
        yield Conflict(
            (*key, "watchdog", "feed"),
            "is missing; needed: a register whose writing moves nothing",
            "add [daq.output.watchdog.feed]",
        )
    tripped = watchdog.get("tripped")
    if isinstance(tripped, Mapping):
        yield from _rule(tripped, (*key, "watchdog", "tripped"))
    drops = watchdog.get("drops", ("reference", "enable"))
    if isinstance(drops, list | tuple) and "enable" in drops and enable is None:
        yield Conflict(
            (*key, "watchdog", "drops"),
            "names enable, but there is no [daq.output.enable]",
            'name "reference" only, or describe the enable line',
        )
