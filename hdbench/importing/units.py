"""What headers of foreign logs state: a time, or a unit and what turns it into ours."""

from __future__ import annotations

import re
from decimal import Decimal

from hdbench.records.trace import unit_of_column

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
# pi/30, pi/180 and 2 pi to 28 digits; pound and foot-pound by their international definitions
_PER_RPM = Decimal("0.1047197551196597746154214461")
_PER_DEGREE = Decimal("0.01745329251994329576923690769")
_PER_TURN = Decimal("6.283185307179586476925286767")
_POUND_KG = Decimal("0.45359237")
_KILOPOND_N = Decimal("9.80665")
_FOOT_POUND_NM = Decimal("1.3558179483314004")
_SCALES: dict[str, dict[str, Decimal]] = {
    "s": {
        **dict.fromkeys(("s", "sec", "second", "seconds"), Decimal(1)),
        **dict.fromkeys(("ms", "msec", "milliseconds"), Decimal("0.001")),
        **dict.fromkeys(("us", "µs", "μs"), Decimal("0.000001")),
        **dict.fromkeys(("ns", "nanoseconds"), Decimal("0.000000001")),
        "min": Decimal(60),
    },
    "rad/s": {
        **dict.fromkeys(("rad/s", "rad/sec", "rad s-1", "radians/s"), Decimal(1)),
        **dict.fromkeys(("rpm", "1/min", "min-1", "min^-1", "r/min", "u/min"), _PER_RPM),
        **dict.fromkeys(("tr/min", "giri/min", "upm"), _PER_RPM),
        **dict.fromkeys(("deg/s", "°/s", "degrees/s"), _PER_DEGREE),
        **dict.fromkeys(("rev/s", "1/s"), _PER_TURN),
        **dict.fromkeys(("deg/sec", "°/sec", "dps"), _PER_DEGREE),
        **dict.fromkeys(("rev/min", "turns/min"), _PER_RPM),
        **dict.fromkeys(("rev/sec", "turns/s"), _PER_TURN),
        "rad/min": Decimal(1) / 60,
        "mrad/s": Decimal("0.001"),
        "krpm": _PER_RPM * 1000,
    },
    "rad": {
        **dict.fromkeys(("rad", "radian", "radians"), Decimal(1)),
        "mrad": Decimal("0.001"),
        **dict.fromkeys(
            ("deg", "°", "degree", "degrees", "degrés", "gradi", "grados"), _PER_DEGREE
        ),
        **dict.fromkeys(("rev", "turns", "turn"), _PER_TURN),
    },
    "N m": {
        **dict.fromkeys(("nm", "newtonmeter", "newtonmetre"), Decimal(1)),
        "mnm": Decimal("0.001"),
        "knm": Decimal(1000),
        "ncm": Decimal("0.01"),
        "nmm": Decimal("0.001"),
        **dict.fromkeys(("kgfm", "kpm"), _KILOPOND_N),
        **dict.fromkeys(("kgfcm", "kpcm", "kgcm"), _KILOPOND_N / 100),
        **dict.fromkeys(("gfcm", "gcm"), _KILOPOND_N / 100_000),
        **dict.fromkeys(("ozin", "ozfin", "inoz"), _FOOT_POUND_NM / 192),
        **dict.fromkeys(("ftlb", "ftlbf", "lbft", "lbfft"), _FOOT_POUND_NM),
        **dict.fromkeys(("inlb", "inlbf", "lbin", "lbfin"), _FOOT_POUND_NM / 12),
    },
    "V": {
        **dict.fromkeys(("v", "volt", "volts"), Decimal(1)),
        **dict.fromkeys(("mv", "millivolt", "millivolts"), Decimal("0.001")),
        **dict.fromkeys(("uv", "µv", "μv"), Decimal("0.000001")),
    },
    "A": {**dict.fromkeys(("a", "amp", "amps", "ampere"), Decimal(1)), "ma": Decimal("0.001")},
    "degC": dict.fromkeys(("c", "°c", "degc", "deg c"), Decimal(1)),
    "kg": {"kg": Decimal(1), "g": Decimal("0.001"), "lb": _POUND_KG, "lbs": _POUND_KG},
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
