"""The baseline of a diagnosis can be changed, and what is taken out of it is then found."""

import numpy as np
import pytest
from swinging_shaft import NOISE_NM, RIPPLE, swing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.discovery.baseline import parse_baseline
from hdbench.errors import UsageError
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


def record():
    time = np.arange(10_000) * 1e-3
    lines = (*RIPPLE, (6.0, 0.3, 0.0), (0.01, 0.9, 0.0))
    speed, angle, torque = swing(time, 110.0, 30.0, 5.0, lines)
    torque += NOISE_NM * np.random.default_rng(4).standard_normal(len(time))
    return trace_of(time, speed, angle, torque)


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
    (order,) = [c.parameters["order"].value for c in found.causes if "order" in c.parameters]
    # a hundredth of the resolution of 175 turns
    assert order == pytest.approx(4.0, abs=6e-5)
    assert found.settings["baseline"] == ["+order:6", "-order:4", "-misalignment"]


@pytest.mark.parametrize(
    "term", ["misalignment", "+misalignment", "-zero", "+order:nan", "-order:"]
)
def test_what_is_no_term_is_told(term):
    with pytest.raises(UsageError, match="-order:NUMBER"):
        parse_baseline([term])
