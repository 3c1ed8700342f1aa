"""Numbers, missing values and stamps, as cells of text hold them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from decimal import Decimal, InvalidOperation

MISSING = frozenset(("", "nan", "na", "n/a", "-nan", "nan(ind)", "-nan(ind)", "null", "none"))
_COMMA_NUMBER = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
# the year first, or the day first with points between: no other order can be told for sure
_STAMP = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/](?P<month>\d\d?)[-/](?P<day>\d\d?)"
    r"|(?P<day2>\d\d?)\.(?P<month2>\d\d?)\.(?P<year2>\d{4}))(?:T|\s+))?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d(?:[.,]\d{1,9})?)"
    r"\s*(?P<zone>Z|[+-]\d\d:?\d\d)?"
)
_EPOCH = date(1970, 1, 1).toordinal()


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a point or a comma."""
    word = cell.strip()
    if _COMMA_NUMBER.fullmatch(word):
        return True
    try:
        return word.isascii() and "_" not in word and Decimal(word).is_finite()
    except InvalidOperation:
        return False


def says_number(cell: str) -> bool:
    """Return whether a cell is a number, or a word that says that there is none."""
    return bool(cell.strip()) and (is_number(cell) or cell.strip().lower() in MISSING)


def stamp_seconds(cell: str) -> Decimal | None:
    """Return a stamp in s: since 1970 with a date, since midnight without; None for other text."""
    match = _STAMP.fullmatch(cell.strip())
    if match is None:
        return None
    days = 0
    if year := match["year"] or match["year2"]:
        month, day = match["month"] or match["month2"], match["day"] or match["day2"]
        try:
            days = date(int(year), int(month), int(day)).toordinal() - _EPOCH
        except ValueError:
            return None
    minutes = 60 * int(match["hour"]) + int(match["minute"])
    if match["zone"] not in (None, "Z"):
        sign, digits = match["zone"][0], match["zone"][1:].replace(":", "")
        minutes -= int(f"{sign}1") * (60 * int(digits[:2]) + int(digits[2:]))
    return 86400 * days + 60 * minutes + Decimal(match["second"].replace(",", "."))


def uses_decimal_comma(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether numbers are like 1,5 and none is like 1.5."""
    found = False
    for row in rows:
        for cell in row:
            word = cell.strip()
            if _COMMA_NUMBER.fullmatch(word):
                found = True
            elif "." in word and _COMMA_NUMBER.fullmatch(word.replace(".", ",", 1)):
                return False
    return found
