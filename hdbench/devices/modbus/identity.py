"""Who answers: the values by which the profile knows the device, checked before any write."""

from __future__ import annotations

from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import place_of
from hdbench.devices.modbus.rules import fits, needed
from hdbench.devices.modbus.values import Order, encode
from hdbench.devices.modbus.window import is_emulator
from hdbench.devices.ports import Identity
from hdbench.errors import DeviceError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusIdentify

__all__ = ["check_identity"]

_ORDERS: dict[Order, str] = {
    "CDAB": "words swapped",
    "BADC": "bytes swapped",
    "DCBA": "bytes and words swapped",
}


def check_identity(access: Access, table: ModbusAcquisition) -> Identity:
    """Return who answers, if it is the device that the profile means."""
    places = [place_of(table, rule) for rule in table.identify]
    for rule, place, found in zip(table.identify, places, access.read(places), strict=True):
        if not fits(rule, found):
            raise DeviceError(
                f"reads {found:.9g}; needed: {needed(rule)}{_hint(rule, found)}",
                where=f"{access.where}, {place.name}",
                fix="this is another device, or its byte order is another: correct daq.address or "
                "daq.identify, then channels and order",
            )
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
