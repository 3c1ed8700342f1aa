"""The diagnosis finds what a bench with its own physics hides, and nothing else.

The quick form of the benchmark: forty records on fixed seeds. A rate that is at its pass level
breaks a bound here with less than 1 % (binomial law).
"""

from dataclasses import replace

import pytest
from injector.build import Case, Hidden
from injector.loads import LOAD_FAMILIES
from runner import answer_case
from scorer.judge import judge, open_truth
from scorer.tables import one_line

_SEED = 41000
_NAMES = (
    "ripple-harmonic", "motor-unbalance", "structural-tone", "coulomb-friction",
    "viscous-friction", "gain-error", "cubic-nonlinearity", "hysteresis", "zero-step",
    "position-dependent-gain",
)  # fmt: skip

CLEAN = tuple(
    Case(f"quick-clean-{k}", "A", "compact", noise, seed=_SEED + k)
    for k, noise in enumerate(("white", "ar", "white", "ar"))
)
DYNAMIC = tuple(
    Case(f"quick-{name}", "B", "compact", ("white", "ar")[k % 2], seed=_SEED + 100 + k,
         hidden=(Hidden(name, "d20"),))
    for k, name in enumerate(_NAMES)
)  # fmt: skip
LOADS = tuple(
    Case(f"quick-loads-{name or 'clean'}-{k}", "L", "loads", sigma_nm=0.005,
         seed=_SEED + 200 + 10 * k + len(name), hidden=(Hidden(name, tier),) if name else ())
    for k, tier in enumerate(("d20", "high"))
    for name in (*LOAD_FAMILIES, "", "", "", "")
)  # fmt: skip


def judged(cases):
    """(truth, verdict, line) of each case; no record may crash or be refused."""
    out = []
    for case in cases:
        sealed, entry = answer_case(case, with_oracle=False)
        assert "crashed" not in entry, entry["crashed"]
        assert "refused" not in entry, entry["refused"]
        truth = open_truth(sealed, entry["seal"])
        verdict = judge(truth, entry)
        out.append((truth, verdict, one_line(truth, entry, verdict)))
    return out


def quick(cases):
    """The same effects on shorter records."""
    return [replace(case, record="quick") for case in cases]


def some_and_all(some, every):
    """A few records in the tests, all of them in a campaign."""
    more = pytest.param(every, marks=pytest.mark.campaign, id="all")
    return pytest.mark.parametrize("cases", [pytest.param(some, id="some"), more])


@some_and_all(quick(CLEAN[:1]), CLEAN)
def test_clean_records_give_no_finding(cases):
    lines = [line for _, verdict, line in judged(cases) if verdict.alarm]
    # four records at 2 %: two alarms in 0.2 %
    assert len(lines) <= len(cases) // 4, "\n".join(lines)


@some_and_all(quick(DYNAMIC[8:9]), DYNAMIC)
def test_effects_of_twenty_sigma_are_found_under_sets_that_hold_their_names(cases):
    answers = judged(cases)
    missed = [line for _, verdict, line in answers if not verdict.alarm]
    strange = [line for _, verdict, line in answers if verdict.alarm and not verdict.covered]
    certain = [line for _, verdict, line in answers if verdict.wrong_certain]
    # ten records, detection 99 %, name in the set 95 %, certain of a wrong one 1 %:
    # beyond these counts in 0.4 %, 0.1 % and 0.4 %
    assert len(missed) <= len(cases) // 10, "\n".join(missed)
    assert len(strange) <= 3 * len(cases) // 10, "\n".join(strange)
    assert len(certain) <= len(cases) // 10, "\n".join(certain)


@some_and_all(LOADS[: len(LOADS) // 2 : 2], LOADS)
def test_static_effects_are_found_in_calibration_loads_and_clean_ones_stay_silent(cases):
    answers = judged(cases)
    clean = [line for truth, verdict, line in answers if not truth["hidden"] and verdict.alarm]
    missed = [line for truth, v, line in answers if truth["hidden"] and not v.alarm]
    strange = [line for truth, v, line in answers if truth["hidden"] and v.alarm and not v.covered]
    # eight clean ones at 1 %, eighteen effects at 99 % and 95 %: beyond in 0.3 %, 1 % and 0.2 %
    assert len(clean) <= len(cases) // 26, "\n".join(clean)
    assert len(missed) <= len(cases) // 26, "\n".join(missed)
    assert len(strange) <= 4 * len(cases) // 26, "\n".join(strange)
