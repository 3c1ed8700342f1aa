"""The baseline of a diagnosis can be changed, and what is taken out of it is then found."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.discovery.baseline import parse_baseline
from hdbench.errors import UsageError
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")


def record(seconds=16.0):
    rng = np.random.default_rng(4)
    n = round(seconds * 1000)
    time = np.arange(n) * 1e-3
    speed = 110.0 + 30.0 * np.sin(2.0 * np.pi * time / 5.0)
    angle = 110.0 * time + 150.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time / 5.0))
    torque = 1.725e-4 * 30.0 * 2.0 * np.pi / 5.0 * np.cos(2.0 * np.pi * time / 5.0)
    torque += 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle)
    torque += 0.3 * np.cos(6.0 * angle) + 0.9 * np.cos(angle / 100.0)
    torque += 0.05 * rng.standard_normal(n)
    columns = {"time_s": time, "motor_velocity_rad_s": speed, "motor_angle_rad": angle}
    return Trace({**columns, "torque_nm": torque})


def names(*terms):
    found = diagnose_trace(record(), PROFILE, baseline=terms)
    return {cause.name for cause in found.causes}, found


def test_an_order_that_is_added_to_the_baseline_is_no_cause():
    assert names()[0] == {"ripple-harmonic"}
    assert names("+order:6")[0] == set()


def test_an_order_and_a_misalignment_that_are_taken_out_are_found_as_causes():
    causes, found = names("+order:6", "-order:4", "-misalignment")
    assert {"ripple-harmonic", "misalignment"} == causes or {
        "ripple-harmonic",
        "load-gravity",
    } == causes
    (order,) = [c.parameters["order"]["value"] for c in found.causes if "order" in c.parameters]
    # a hundredth of the resolution of 280 turns
    assert order == pytest.approx(4.0, abs=4e-5)
    assert found.settings["baseline"] == ["+order:6", "-order:4", "-misalignment"]


@pytest.mark.parametrize(
    "term", ["misalignment", "+misalignment", "-zero", "+order:nan", "-order:"]
)
def test_what_is_no_term_is_told(term):
    with pytest.raises(UsageError, match="-order:NUMBER"):
        parse_baseline([term])
