"""Profiles of Modbus devices: their rules, and the benches that come with hdbench."""

import numpy as np
import pytest
from changing import with_daq
from served import sampled

from hdbench.devices import open_bench
from hdbench.devices.bench import AcquisitionSettings
from hdbench.devices.feasibility import check_pace
from hdbench.errors import ProfileError, UsageError
from hdbench.profile import load_profile
from hdbench.profile.loader import parse_profile
from hdbench.profile.schema import ReferenceWave

COMMON = 'driver = "modbus"\nsample_period_s = 0.1\n'
CHANNEL = '[[daq.channels]]\nrole = "torque"\naddress = 40001\n'
KNOWN = "[[daq.identify]]\naddress = 40100\nequals = 7\n"
OUTPUT = "[daq.output]\naddress = 40011\nlimit_v = 5.0\n"
WATCHDOG = """[daq.output.watchdog]
unit_s = 0.001
min_s = 0.1
max_s = 60.0
fed_by = "write"
drops = ["reference"]
time = { address = 44385 }
tripped = { address = 44129, equals = 0 }
"""
MODICON = 'numbering = "modicon"\n'
ALL = COMMON + MODICON + CHANNEL + KNOWN + OUTPUT + WATCHDOG


def problems(daq):
    with pytest.raises(ProfileError) as caught:
        parse_profile(with_daq(daq), "bench.toml")
    found = caught.value.problems or (caught.value,)
    return " | ".join(error.what for error in found)


@pytest.mark.parametrize(
    ("daq", "words"),
    [
        (COMMON + CHANNEL + 'order = "ACBD"\n', "'ABCD', 'CDAB', 'BADC' or 'DCBA'"),
        (
            COMMON + MODICON + CHANNEL.replace("40001", "30001"),
            "40001 to 49999 or 400001 to 465536",
        ),
        (COMMON + CHANNEL.replace("40001", "70000"), "0 to 65535"),
        (COMMON + MODICON + CHANNEL + OUTPUT, "that nothing identifies"),
        (COMMON + MODICON + CHANNEL + KNOWN.replace("equals = 7\n", ""), "what it must read"),
        (ALL, "whose writing moves nothing"),
        (ALL.replace('["reference"]', '["enable"]'), "no [daq.output.enable]"),
        (COMMON + "max_read_registers = 1\n" + CHANNEL + 'type = "f32"\n', "takes 2 registers"),
        (COMMON + MODICON + KNOWN + OUTPUT + 'type = "f32"\nfunction = 6\n', "writes one register"),
        (COMMON + CHANNEL.replace("torque", "encoder") + "scale = 0.5\n", "polled in counts"),
        (COMMON + CHANNEL + "wrap_bits = 16\n", "for an encoder only"),
        (COMMON + CHANNEL + "scale = 0.0\n", "units per step|is 0"),
    ],
)
def test_a_profile_that_cannot_work_is_refused_with_the_key(daq, words):
    said = problems(daq)
    assert any(word in said for word in words.split("|")), said


@pytest.mark.parametrize("name", ["seneca-z-sg", "laumas-tlb4", "adam-6024", "di-2108-ek9000"])
def test_a_ready_profile_says_what_it_was_tried_on(name):
    assert load_profile(name).data.daq.verified == "emulator"


@pytest.mark.parametrize("name", ["seneca-z-sg", "laumas-tlb4", "adam-6024"])
def test_a_ready_bench_measures_a_weight(name):
    profile = load_profile(name)
    with open_bench(profile, seed=4) as bench:
        fixture = {"locked": True, "position_rad": 0.0, "mass_kg": 0.0, "direction": 1}
        bench.simulation.set(fixture=fixture)
        means_v = []
        for mass_kg in (0.0, 4.0):
            bench.simulation.set(fixture={**fixture, "mass_kg": mass_kg})
            volts = sampled(bench, AcquisitionSettings(0.1, 8, None)).torque_v
            means_v.append(np.mean(volts[-4:]))
        assert bench.safe_state().confirmed
    # 4 kg on 0.5 m at 6.6 N m/V; the weight may still swing, and a position has its own gain
    assert means_v[1] - means_v[0] == pytest.approx(4 * 0.5 * 9.8065 / 6.6, rel=0.2)


@pytest.mark.parametrize("name", ["seneca-z-sg", "laumas-tlb4", "adam-6024"])
def test_a_plan_that_is_too_fast_is_refused_before_anything_is_opened(name):
    with pytest.raises(UsageError, match="asks for 1000 samples/s"):
        check_pace(load_profile(name).data, 1e-3, "the ripple run")
    check_pace(load_profile(name).data, 0.2, "a calibration")


@pytest.mark.usefixtures("patient_control")
def test_a_composite_moves_the_motor_and_stops_it():
    profile = load_profile("di-2108-ek9000")
    wave = ReferenceWave(wave="constant", amplitude_v=1.0)
    with open_bench(profile, seed=4) as bench:
        got = sampled(bench, AcquisitionSettings(1e-3, 1500, wave))
        safe = bench.safe_state()
    speed = got.tacho_v * profile.data.tacho.gain_rad_s_per_v
    assert max(speed) == pytest.approx(56.3, rel=0.05)
    turned = sum(speed) * 1e-3 * profile.data.encoder.counts_per_turn / 6.283185
    assert got.encoder_count[-1] - got.encoder_count[0] == pytest.approx(turned, abs=40)
    assert (safe.confirmed, safe.reference_v) == (True, 0.0)
