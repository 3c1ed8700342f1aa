"""A reduced campaign of wrong, stale, duplicate, reordered and mutated replies."""

from pathlib import Path

import pytest
from faults import polled

# deadlines that other work on this machine does not pass for a fault
DEADLINES_S = {"tcp": 0.25, "rtu": 0.4, "rtu+tcp": 0.4}
FAULTS = {"tcp": 6, "rtu": 3, "rtu+tcp": 3}
TOLD = [
    (wire, kind)
    for wire in polled.WIRES
    for kind in polled.KINDS
    if (wire, kind) not in polled.UNTOLD and (wire == "tcp" or kind not in polled.NUMBERED)
]


@pytest.mark.parametrize(("wire", "kind"), TOLD)
def test_no_reading_is_another_one_s_and_no_write_is_believed_that_was_none(wire, kind):
    found = polled.campaign(wire, kind, FAULTS[wire], deadline_s=DEADLINES_S[wire])
    assert found.faults >= FAULTS[wire] // 2
    assert (found.wrong_readings, found.wrong_writes) == (0, 0)
    assert found.readings + found.writes > 0


def test_what_tcp_cannot_tell_is_what_the_documentation_says():
    """A page that says so must be right: changed bits inside TCP do come through."""
    found = polled.campaign("tcp", "mutate", 30, deadline_s=DEADLINES_S["tcp"])
    page = (Path(__file__).parents[3] / "docs" / "modbus-devices.md").read_text()
    assert "cannot be told" in page
    assert found.wrong_readings > 0
