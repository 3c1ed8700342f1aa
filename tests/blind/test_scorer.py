"""The scorer counts what its definitions say."""

import json

import pytest
from injector.build import Case, Hidden
from injector.seal import case_text, salt_of, seal
from scorer.judge import judge
from scorer.levels import LEVELS, interval, most_by_chance
from scorer.metrics import Row, figures, mark
from scorer.truth import open_truth


def truth(*effects, part="B"):
    hidden = [
        {"name": name, "tier": "d10", "d": 10.0, "alike": alike, "domain": "velocity",
         "agrees": True, "bounds": {}, "values": {}, "perpendicular": 0.5}
        for name, alike in effects
    ]  # fmt: skip
    return {"key": "k", "part": part, "record": "short", "noise": "white", "hidden": hidden,
            "fault": "", "note": "", "seconds": 60.0, "turns": 100.0}  # fmt: skip


def said(*causes, left=()):
    entries = [
        {"name": name, "group": [name, *group], "rivals": list(rivals), "parameters": {}}
        for name, group, rivals in causes
    ]
    unexplained = [{"domain": domain, "location": 1.0} for domain in left]
    return {"key": "k", "seconds": 1.0, "peak_mb": 1.0, "answer": {
        "causes": entries, "unexplained": unexplained, "minor": [], "data_flags": []}}  # fmt: skip


COULOMB = ("coulomb-friction", {"coulomb-friction": 0.0, "presliding": 0.2})
STEP = ("zero-step", {"zero-step": 0.0, "warm-up": 0.004})


def test_true_name_alone_is_exact():
    verdict = judge(truth(COULOMB), said(("coulomb-friction", (), ())))
    assert verdict.exact
    assert verdict.covered
    assert not verdict.wrong_certain


def test_rival_makes_it_covered_and_two_in_the_set():
    verdict = judge(truth(COULOMB), said(("coulomb-friction", (), ("presliding",))))
    assert not verdict.exact
    assert verdict.covered
    assert verdict.set_size == 2.0


def test_other_name_of_the_same_space_is_exact():
    assert judge(truth(STEP), said(("warm-up", ("zero-step",), ()))).exact


def test_wrong_name_without_rivals_is_wrong_certain_and_with_rivals_is_not():
    assert judge(truth(COULOMB), said(("gain-error", (), ()))).wrong_certain
    assert not judge(truth(COULOMB), said(("gain-error", (), ("zero-step",)))).wrong_certain


def test_second_name_is_a_phantom_and_spoils_the_exactness():
    verdict = judge(truth(COULOMB), said(("coulomb-friction", (), ()), ("creep", (), ())))
    assert verdict.phantoms == 1
    assert not verdict.exact
    assert verdict.covered


def test_two_effects_need_a_cause_each():
    both = truth(COULOMB, STEP, part="C")
    one = judge(both, said(("coulomb-friction", (), ("zero-step",))))
    two = judge(both, said(("zero-step", (), ()), ("coulomb-friction", (), ())))
    assert one.found == 1
    assert not one.covered
    assert two.exact


def test_clean_record_with_an_unexplained_place_is_a_false_alarm():
    clean = truth(part="A")
    rows = [
        Row((clean, said(left=("time",)), judge(clean, said(left=("time",))))),
        Row((clean, said(), judge(clean, said()))),
    ]
    assert figures(rows)["false_alarms_white"] == (0.5, 2)
    assert figures(rows)["false_names_white"] == (0.0, 2)


def test_no_answer_is_a_miss_and_counted():
    entry = {"key": "k", "seconds": 1.0, "peak_mb": 1.0, "crashed": "x"}
    row = Row((truth(COULOMB), entry, judge(truth(COULOMB), entry)))
    assert figures([row])["crashes"] == (1.0, 1)
    assert figures([row])["detection_d10"] == (0.0, 1)


def test_one_number_marks():
    marks = []
    for entry in (
        said(("coulomb-friction", (), ())),
        said(("coulomb-friction", (), ("presliding",))),
        said(),
        said(("gain-error", (), ())),
    ):
        marks.append(mark(Row((truth(COULOMB), entry, judge(truth(COULOMB), entry)))))
    assert marks == [1.0, 0.5, 0.0, -1.0]


def test_truth_opens_only_with_its_seal():
    case = Case("k", "B", "short", seed=7, hidden=(Hidden("creep", "d5"),))
    sealed = {"key": "k", "salt": salt_of(case), "text": case_text(case)}
    mark_of = seal(sealed["salt"], sealed["text"])
    assert open_truth(sealed, mark_of)["hidden"] == [{"name": "creep", "tier": "d5", "fixed": []}]
    changed = {**sealed, "text": json.dumps({"hidden": []})}
    with pytest.raises(ValueError, match="not the one that was sealed"):
        open_truth(changed, mark_of)


def test_counts_that_chance_may_reach_are_those_of_the_binomial_law():
    assert most_by_chance(600, 0.01) == 14
    assert most_by_chance(600, 0.016) == 20
    from scipy.stats import binom

    for count, rate in ((300, 0.01), (1000, 0.01), (120, 0.02)):
        assert most_by_chance(count, rate) == binom.isf(0.002, count, rate)


def test_interval_of_a_share_is_wilsons():
    from statsmodels.stats.proportion import proportion_confint

    for share, count in ((0.0, 30), (0.4, 50), (1.0, 12)):
        low, high = proportion_confint(share * count, count, method="wilson")
        assert interval(share, count) == pytest.approx((low, high), abs=1e-6)


def test_levels_have_a_figure_each():
    keys = figures([])
    assert [level.key for level in LEVELS if level.key not in keys] == []
