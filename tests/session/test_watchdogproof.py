"""The watchdog is proven by a motor that stood after silence, and by nothing less."""

import math

import pytest
from fakes import WHOLE
from nodekit import realtime_emulator

from hdbench.devices.bench import SafeState
from hdbench.session.stop import StopSignals
from hdbench.session.watchdogproof import _judged, creep_rad_s, prove_watchdog

SAFE = SafeState(True, 0.0, 0.0, "safe")


def test_a_node_whose_watchdog_works_is_proven():
    with realtime_emulator(WHOLE.data) as found:
        proof = prove_watchdog(WHOLE, StopSignals(), address=found["address"])
    assert proof.proven, proof.detail
    assert proof.creep_rad_s == pytest.approx(creep_rad_s(WHOLE.data), rel=0.1)
    assert abs(proof.after_rad_s) < 0.5
    assert proof.safe.confirmed


@pytest.mark.parametrize(
    ("creep", "found", "word"),
    [
        (8.0, (True, 7.9, ""), "STILL TURNED"),
        (8.0, (False, 0.0, ""), "says it has not acted"),
        (0.1, (True, 0.0, ""), "did not turn"),
        (8.0, (True, None, ""), "measures no motor speed"),
        (8.0, (True, math.nan, ""), "STILL TURNED"),
        (8.0, (False, None, "no reply"), "does not answer: no reply"),
    ],
)
def test_anything_less_is_no_proof(creep, found, word):
    proof = _judged(creep, 0.5, found, SAFE)
    assert not proof.proven
    assert word in proof.detail


def test_a_bench_that_is_not_safe_afterwards_is_not_proven():
    unsafe = SafeState(False, None, None, "no answer")
    assert _judged(8.0, 0.5, (True, 0.0, ""), SAFE).proven
    assert not _judged(8.0, 0.5, (True, 0.0, ""), unsafe).proven
