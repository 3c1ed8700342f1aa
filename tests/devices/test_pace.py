"""A device that is too slow is told from the profile alone, before anything is opened."""

import pytest
from changing import REPORT, with_keys

from hdbench.devices.driver import driver_of
from hdbench.devices.feasibility import check_pace
from hdbench.errors import UsageError

THREE = ("torque", "tacho", "encoder")
ALL = ("torque", "tacho", "current", "reference", "encoder")


def at(address, channels=ALL):
    return with_keys(REPORT, daq={"address": address, "channels": channels})


def rate_limit_hz(table):
    return driver_of(table.driver).rate_hz(table)


def by_hand(baud, n_channels):
    """90 % of scans in a block over the time of 17 and 5 + 2 n characters and two silences."""
    scans = 113 // n_channels
    characters = 17 + 5 + 2 * (12 + scans * n_channels) + 7
    return 0.9 * scans / (characters * 11 / baud)


@pytest.mark.parametrize(("baud", "channels"), [(115200, THREE), (921600, ALL), (57600, THREE)])
def test_the_limit_of_a_serial_line_is_that_of_its_characters(baud, channels):
    found = rate_limit_hz(at(f"rtu:///dev/ttyUSB0?baud={baud}", channels).daq)
    assert found == pytest.approx(by_hand(baud, len(channels)), rel=1e-12)


def test_three_channels_at_115200_keep_one_kilohertz_and_five_do_not():
    check_pace(at("rtu:///dev/ttyUSB0?baud=115200", THREE), 1e-3, "the run")
    check_pace(at("rtu:///dev/ttyUSB0?baud=921600"), 1e-3, "the run")
    with pytest.raises(
        UsageError, match=r"the run asks for 1000 samples/s; 5 channels of node"
    ) as c:
        check_pace(at("rtu:///dev/ttyUSB0?baud=115200"), 1e-3, "the run")
    assert "fewer daq.channels" in c.value.fix


def test_the_period_that_the_fix_names_is_accepted():
    slow = at("rtu:///dev/ttyUSB0?baud=9600")
    with pytest.raises(UsageError) as caught:
        check_pace(slow, 1e-3, "the run")
    named_s = float(caught.value.fix.split("every ")[1].split(" s")[0])
    check_pace(slow, 1.01 * named_s, "the run")


def test_the_silence_of_the_profile_counts():
    fast, slow = (
        rate_limit_hz(at(f"rtu:///dev/ttyUSB0?baud=921600&gap_us={gap}").daq) for gap in (100, 1750)
    )
    assert slow < 0.6 * fast


@pytest.mark.parametrize("address", ["embedded", "tcp://bench-7:502"])
def test_a_network_and_the_embedded_bench_keep_ten_kilohertz(address):
    check_pace(at(address), 1e-4, "the run")
