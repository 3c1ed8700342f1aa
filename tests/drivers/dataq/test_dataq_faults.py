"""A reduced campaign of spoilt streams."""

import pytest
from faults import dataq


@pytest.mark.parametrize(
    "name", [name for name in dataq.FAULTS if not name.startswith(("five", "bit", "bytes"))]
)
def test_a_spoilt_stream_gives_no_wrong_scan_and_is_told(name):
    found = dataq.campaign(name, 200)
    assert (found["trials_wrong"], found["errors"]) == (0, 200)


@pytest.mark.parametrize("name", ["bytes missing", "bytes inserted"])
def test_bytes_too_few_or_too_many_are_told(name):
    found = dataq.campaign(name, 200)
    # a run of bytes equal to those after it, one time in 256 to 65536, is no change at all
    assert (found["trials_wrong"], found["errors"] >= 195) == (0, True)


@pytest.mark.parametrize("name", ["five packets dropped", "bit of a sample"])
def test_what_the_stream_cannot_tell_comes_through(name):
    """The page that says so is right: whole scans and single bits."""
    assert dataq.campaign(name, 50)["trials_wrong"] > 20
