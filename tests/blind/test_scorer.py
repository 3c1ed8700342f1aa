"""The scorer counts what its definitions say."""

import json

import pytest
from injector.build import Case, Hidden
from injector.cases import grid
from injector.seal import case_text, salt_of, seal
from scorer.judge import judge, open_truth
from scorer.levels import LEVELS, counted
from scorer.metrics import Row, figures, mark


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


@pytest.mark.parametrize(
    ("effect", "causes", "expected"),
    [
        (COULOMB, [("coulomb-friction", (), ())],
         {"exact": True, "covered": True, "wrong_certain": False}),
        (COULOMB, [("coulomb-friction", (), ("presliding",))],
         {"exact": False, "covered": True, "set_size": 2.0}),
        # another name of the same space
        (STEP, [("warm-up", ("zero-step",), ())], {"exact": True}),
        (COULOMB, [("gain-error", (), ())], {"wrong_certain": True}),
        (COULOMB, [("gain-error", (), ("zero-step",))], {"wrong_certain": False}),
        (COULOMB, [("coulomb-friction", (), ()), ("creep", (), ())],
         {"phantoms": 1, "exact": False, "covered": True}),
    ],
)  # fmt: skip
def test_one_effect_is_judged_by_the_names_of_all_causes(effect, causes, expected):
    verdict = judge(truth(effect), said(*causes))
    assert {key: getattr(verdict, key) for key in expected} == expected


def rows_of(known, *answers):
    return [Row((known, answer, judge(known, answer))) for answer in answers]


def test_the_first_name_is_right_with_rivals_and_wrong_as_a_rival():
    answers = [said(("coulomb-friction", (), ("presliding",))),
               said(("presliding", (), ("coulomb-friction",))), said()]  # fmt: skip
    rows = rows_of(truth(COULOMB), *answers)
    assert figures(rows)["first_d10"] == (pytest.approx(1.0 / 3.0), 3)


def test_two_effects_of_one_group_are_one():
    other = ("warm-up", {"zero-step": 0.004, "warm-up": 0.0})
    near = ("warm-up", {"zero-step": 0.02, "warm-up": 0.0})
    pairs = [truth(STEP, other, part="C"), truth(STEP, near, part="C")]
    answer = said(("zero-step", (), ()), ("warm-up", (), ()))
    rows = [row for pair in pairs for row in rows_of(pair, answer)]
    assert figures(rows)["both_d10"] == (1.0, 1)


def test_two_effects_need_a_cause_each():
    both = truth(COULOMB, STEP, part="C")
    one = judge(both, said(("coulomb-friction", (), ("zero-step",))))
    two = judge(both, said(("zero-step", (), ()), ("coulomb-friction", (), ())))
    assert one.found == 1
    assert not one.covered
    assert two.exact


def test_clean_record_with_an_unexplained_place_is_a_false_alarm():
    rows = rows_of(truth(part="A"), said(left=("time",)), said())
    assert figures(rows)["false_alarms_white"] == (0.5, 2)
    assert figures(rows)["false_names_white"] == (0.0, 2)


def test_no_answer_is_a_miss_and_counted():
    entry = {"key": "k", "seconds": 1.0, "peak_mb": 1.0, "crashed": "x"}
    numbers = figures(rows_of(truth(COULOMB), entry))
    assert (numbers["crashes"], numbers["detection_d10"]) == ((1.0, 1), (0.0, 1))


def test_one_number_marks():
    answers = [
        said(("coulomb-friction", (), ())),
        said(("coulomb-friction", (), ("presliding",))),
        # a set of more than three says nothing
        said(("coulomb-friction", (), ("presliding", "creep", "zero-step"))),
        said(),
        said(("gain-error", (), ())),
    ]
    assert list(map(mark, rows_of(truth(COULOMB), *answers))) == [1.0, 0.5, 0.0, 0.0, -1.0]


def test_truth_opens_only_with_its_seal():
    case = Case("k", "B", "short", seed=7, hidden=(Hidden("creep", "d5"),))
    sealed = {"key": "k", "salt": salt_of(case), "text": case_text(case)}
    mark_of = seal(sealed["salt"], sealed["text"])
    assert open_truth(sealed, mark_of)["hidden"] == [{"name": "creep", "tier": "d5", "fixed": []}]
    changed = {**sealed, "text": json.dumps({"hidden": []})}
    with pytest.raises(ValueError, match="not the one that was sealed"):
        open_truth(changed, mark_of)


def test_levels_have_a_figure_each():
    keys = figures([])
    assert [level.key for level in LEVELS if level.key not in keys] == []


def bad(fault):
    return {**truth(part="F"), "fault": fault}


def test_a_fault_told_by_its_own_name_is_no_phantom_and_another_name_is():
    right = judge(bad("slip"), said(("encoder-slip", (), ())))
    assert right.fault_told
    assert right.phantoms == 0
    assert not right.wrong_certain
    wrong = judge(bad("slip"), said(("creep", (), ())))
    assert not wrong.fault_told
    assert wrong.phantoms == 1
    flagged = said()
    flagged["answer"]["data_flags"] = [{"name": "stuck-value"}]
    assert judge(bad("stuck"), flagged).fault_told
    assert not judge(bad("gaps"), flagged).fault_told


@pytest.mark.parametrize(
    ("answer", "honest"),
    [
        (said(("viscous-friction", (), ("hysteresis",))), 1.0),
        (said(("viscous-friction", (), ()), left=("velocity",)), 1.0),
        (said(("viscous-friction", (), ())), 0.0),
        (said(), 0.0),
    ],
)
def test_a_near_miss_is_honest_with_rivals_or_a_rest_and_not_in_silence(answer, honest):
    case = truth(("windage", {}), part="D")
    case["hidden"][0] |= {"perpendicular": 0.2}
    assert figures(rows_of(case, answer))["near_miss_honest"] == (honest, 1)


def duel(answer, sigmas):
    case = {**truth(COULOMB, part="E"), "note": "coulomb-friction|zero-step|poor"}
    entry = answer if sigmas is None else {**answer, "proposal": {"sigmas": sigmas}}
    return figures(rows_of(case, entry))["duel_poor_set"]


def test_a_duel_needs_both_names_and_a_run_that_separates_them_when_it_is_driven():
    both = said(("coulomb-friction", ("zero-step",), ()))
    assert duel(both, 12.0) == (1.0, 1)
    assert duel(both, 2.0) == (0.0, 1)
    assert duel(both, None) == (0.0, 1)
    assert duel(said(("coulomb-friction", (), ())), 12.0) == (0.0, 1)


def test_counts_that_chance_explains_keep_the_level_at_either_end():
    by_key = {level.key: level for level in LEVELS}
    # of 200 at 95 % fewer are covered in 0.2 % of campaigns
    assert counted(by_key["cover_d10"], 200) == 180
    assert counted(by_key["false_alarms_white"], 600) == 14
    assert counted(by_key["false_alarms_coloured"], 600) == 20
    assert counted(by_key["crashes"], 2000) == 0
    assert counted(by_key["set_size_d10"], 100) is None


def test_a_coverage_above_its_upper_end_does_not_hold():
    level = next(level for level in LEVELS if level.key == "parameter_coverage")
    assert level.holds(0.95, level.needed)
    assert not level.holds(0.99, level.needed)
    assert not level.holds(0.89, level.needed)


def test_any_beginning_of_the_grid_has_its_share_of_every_cell():
    cases = list(grid(parts="ABCDEF"))
    half = cases[: len(cases) // 2]
    for tier in ("d5", "d7", "d10", "d20"):
        some = [
            [c for c in part if c.part == "B" and c.hidden[0].tier == tier]
            for part in (cases, half)
        ]
        assert abs(len(some[1]) - 0.5 * len(some[0])) <= 3
        # half of three rounds holds every family once
        names = [{c.hidden[0].name for c in part} for part in some]
        assert names[1] == names[0]
    for noise in ("white", "ar", "flicker"):
        some = [[c for c in part if c.part == "A" and c.noise == noise] for part in (cases, half)]
        assert abs(len(some[1]) - 0.5 * len(some[0])) <= 3
    assert len({c.key for c in cases}) == len(cases)
