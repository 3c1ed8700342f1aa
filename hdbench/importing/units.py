"""What headers of foreign logs state: a time, or a unit and what turns it into ours."""

from __future__ import annotations

import re
from decimal import Decimal

from hdbench.records.trace import unit_of_column
from hdbench.system.files import packaged_toml

# a number in brackets is a place in a list
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[(\[](?P<unit>(?!\s*\d+\s*[)\]])[^()\[\]]{1,16})[)\]]\s*")
_BEHIND = re.compile(
    r"(?P<name>.*?[A-Za-z0-9)\]])(?:_|,?\s+(?:in\s+)?|\s*/\s*)(?P<unit>[^\W_][^_\s]*)"
)
_TWO_BEHIND = re.compile(r"(?P<name>.*?[A-Za-z0-9])[_ ](?P<unit>[A-Za-z]+[_ ][A-Za-z]+)")
_PER_BEHIND = re.compile(
    r"(?P<name>.*[A-Za-z0-9])_(?P<above>rad|deg|rev|turns)_?(?:per_)?(?P<below>s|sec|min)"
)
_TIME = re.compile(
    r"(?:(?:relative|elapsed|scan|rel\.?)[ _]*)?times?(?:[ _]*stamp)?(?![a-z]).*", re.I
)


# what another unit is worth, by our unit and its spelling
_SCALES = {
    ours: {word: Decimal(worth) for worth, words in table.items() for word in words}
    for ours, table in packaged_toml(__package__, "units.toml").items()
}


def _spelled(unit: str, wanted: str) -> str:
    word = unit.strip()
    # in small letters mega would be milli
    word = word if re.match("M[NVA]", word) else word.lower()
    # N m, N-m, N*m and Nm are one unit
    return re.sub(r"[\s*·.\-_]", "", word) if wanted == "N m" else word


def _parted(header: str) -> tuple[str, str]:
    """Return a column name and its unit: in brackets behind it, or as its last word."""
    if match := _BRACKETS.fullmatch(header):
        return match["name"].strip(), match["unit"].strip()
    if match := _PER_BEHIND.fullmatch(header):
        return match["name"], f"{match['above']}/{match['below']}"
    match = _TWO_BEHIND.fullmatch(header)
    if match and _spelled(match["unit"], "N m") in _SCALES["N m"]:
        return match["name"], match["unit"]
    match = _BEHIND.fullmatch(header)
    name, unit = (match["name"], match["unit"]) if match else (header, header)
    # one letter, or that of the least value, may mean anything
    return (name, unit) if len(unit) > 1 and unit != "min" and known_unit(unit) else (header, "")


def stated_unit(header: str) -> str:
    """Return the unit that a column name ends with; empty where there is none."""
    return _parted(header)[1]


def bare_name(header: str) -> str:
    """Return a column name without the unit behind it."""
    return _parted(header)[0]


def is_time_name(name: str) -> bool:
    """Return whether a column is named as a time."""
    return _TIME.fullmatch(name.strip().rpartition("/")[2]) is not None


def target_unit(column: str) -> str:
    """Return the unit of one of our columns by its name; empty where no log states such units."""
    unit = unit_of_column(column)
    return unit if unit in _SCALES else ""


def unit_scale(unit: str, wanted: str) -> Decimal | None:
    """Return the factor between two units."""
    scale = _SCALES.get(wanted, {}).get(_spelled(unit, wanted))
    if scale is not None:
        return scale
    return Decimal("NaN") if known_unit(unit) else None


def known_unit(unit: str) -> bool:
    """Return whether a word is a unit of one of our quantities."""
    return any(_spelled(unit, wanted) in scales for wanted, scales in _SCALES.items())
