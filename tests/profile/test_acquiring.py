"""``[daq]``: one table per driver, each with its own keys; errors name key, line and fix."""

import re

import pytest

from hdbench.errors import ProfileError
from hdbench.profile import load_profile, profile_schema
from hdbench.profile.loader import parse_profile

TEXT = load_profile("cim-tr-97-06").text
BEFORE, REST = TEXT.split("[daq]\n", 1)
AFTER = "\n[limits]\n" + REST.split("[limits]\n", 1)[1]
COMMON = "sample_period_s = 0.001\n"


def parse(daq):
    return parse_profile(f"{BEFORE}[daq]\n{daq}{AFTER}", "bench.toml").data.daq


def problems(daq):
    with pytest.raises(ProfileError) as caught:
        parse(daq)
    found = caught.value.problems or (caught.value,)
    return [(error.what, error.fix) for error in found]


def test_without_a_driver_it_is_a_node_with_all_channels():
    table = parse(COMMON)
    assert (table.driver, table.address) == ("node", "embedded")
    assert table.channels == ("torque", "tacho", "current", "reference", "encoder")


def test_a_serial_node_has_its_line():
    table = parse(
        f'driver = "node"\naddress = "rtu:///dev/ttyUSB0"\n{COMMON}channels = ["torque", "tacho"]\n'
        '[daq.serial]\nbaud_bd = 921600\nparity = "none"\nstop_bits = 2\ngap_s = 0.00175\n'
    )
    assert (table.serial.baud_bd, table.serial.gap_s) == (921600, 0.00175)
    assert table.channels == ("torque", "tacho")


def composed(inputs, outputs):
    return f'driver = "composite"\n{COMMON}[daq.inputs]\n{inputs}\n[daq.outputs]\n{outputs}\n'


@pytest.mark.parametrize(
    ("daq", "words", "fix"),
    [
        (f'driver = "nodee"\n{COMMON}', "'daq.driver'.*installed: node", "did you mean 'node'?"),
        (f'driver = "node"\n{COMMON}watchdog = 0.5\n', "'daq.watchdog': unknown", "daq.watchdog_s"),
        (f'driver = "node"\n{COMMON}watchdog_s = 2.5\n', "at most 2.0", "correct"),
        (f'driver = "node"\naddress = "udp://h:1"\n{COMMON}', "another form", "correct"),
        (f'channels = ["torque", "torque"]\n{COMMON}', "torque more than once", "take one"),
        (f'channels = ["torsion"]\n{COMMON}', "'torque', 'tacho'", "correct"),
        (f'address = "tls://h:802"\n{COMMON}', "no \\[daq.tls\\]", "tcp://"),
        (
            f'address = "tcp://h:502"\n{COMMON}[daq.serial]\nbaud_bd = 9600\n',
            "for rtu:// and ascii:// only",
            "take the table out",
        ),
        (f'driver = "labjack-t"\n{COMMON}', "'daq.channels': missing", "channels"),
        (f'driver = "dataq"\n{COMMON}channels = []\n', "'daq.model': missing", "model"),
        (f'driver = "composite"\n{COMMON}', "'daq.inputs': missing", "inputs"),
        (composed("baud = 3", 'address = "tcp://h:1"'), "'daq.inputs.baud': unknown", ""),
        (
            composed('address = "tcp://h:1"', ""),
            "'daq.outputs.address'.*missing",
            "give its address",
        ),
    ],
)
def test_a_wrong_key_is_named_with_what_is_needed_and_a_fix(daq, words, fix):
    found = problems(daq)
    assert any(re.search(words, what) and fix in how for what, how in found), found


def test_no_problem_shows_the_inner_name_of_a_table():
    for daq in (f'driver = "labjack-t"\n{COMMON}', f'driver = "node"\n{COMMON}spam = 1\n'):
        assert not any("driver:" in what for what, _ in problems(daq))


def test_the_schema_for_editors_knows_every_driver():
    text = str(profile_schema())
    for driver in ("node", "modbus", "labjack-t", "dataq", "composite"):
        assert repr(driver) in text
