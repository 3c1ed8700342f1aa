"""Rules between the keys of ``[daq]``, on what can be read even where other keys are wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from hdbench.profile.acquiring import load_table
from hdbench.profile.conflict import Conflict
from hdbench.profile.drivers import BROKEN, closest, find
from hdbench.profile.modbus_checks import modbus_conflicts

__all__ = ["acquiring_problems"]

Key = tuple[str | int, ...]


def acquiring_problems(data: object) -> Iterator[Conflict]:
    """Yield every conflict between keys of ``[daq]``."""
    table = data.get("daq") if isinstance(data, Mapping) else None
    if not isinstance(table, Mapping):
        return
    yield from _table(table, ("daq",))
    for part in ("inputs", "outputs"):
        below = table.get(part)
        if table.get("driver") == "composite" and isinstance(below, Mapping):
            yield from _table(below, ("daq", part))
            yield from _part(table, below, part)


def _table(table: Mapping[object, object], base: Key) -> Iterator[Conflict]:
    driver = table.get("driver", "node")
    if isinstance(driver, str):
        yield from _driver(driver, base)
    yield from _roles(table, base)
    yield from _wire(table, base)
    if driver == "modbus":
        yield from modbus_conflicts(table, base)


def _driver(driver: str, base: Key) -> Iterator[Conflict]:
    if find("hdbench.drivers", driver) is None:
        names, fix = closest(driver)
        yield Conflict((*base, "driver"), f"names {driver!r}; installed: {names}", fix)
    try:
        load_table(driver)
    except BROKEN as error:
        why = f"{type(error).__name__}: {error}"
        yield Conflict(
            (*base, "driver"),
            f"names {driver!r}, whose table cannot be loaded ({why})",
            "install the package of this driver again",
        )


def _roles(table: Mapping[object, object], base: Key) -> Iterator[Conflict]:
    channels = table.get("channels")
    if not isinstance(channels, list | tuple):
        return
    roles = [item.get("role") if isinstance(item, Mapping) else item for item in channels]
    words = [role for role in roles if isinstance(role, str)]
    twice = sorted({role for role in words if words.count(role) > 1})
    if twice:
        yield Conflict(
            (*base, "channels"),
            f"has {', '.join(twice)} more than once; needed: each role once",
            "take one of them out",
        )


def _wire(table: Mapping[object, object], base: Key) -> Iterator[Conflict]:
    address = table.get("address", "embedded")
    if not isinstance(address, str):
        return
    scheme = address.partition("://")[0]
    if scheme == "tls" and table.get("tls") is None:
        yield Conflict(
            (*base, "address"),
            "is tls://, but there is no [daq.tls]; needed: certificate, key, authority",
            "add [daq.tls], or use tcp:// on a network of its own",
        )
    for name, needed in (("serial", ("rtu", "ascii")), ("tls", ("tls",))):
        if table.get(name) is not None and scheme not in (*needed, "embedded"):
            yield Conflict(
                (*base, name),
                f"is for {':// and '.join(needed)}:// only; the address is {scheme}://",
                "take the table out, or change the address",
            )


def _part(
    table: Mapping[object, object], part: Mapping[object, object], name: str
) -> Iterator[Conflict]:
    embedded = (table.get("address") == "embedded", part.get("address", "embedded") == "embedded")
    if embedded == (False, True):
        yield Conflict(
            ("daq", name, "address"),
            'is missing; needed: where this device is, or address = "embedded" in [daq]',
            "give its address",
        )
