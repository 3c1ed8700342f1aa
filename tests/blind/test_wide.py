"""Parts T, W, U and the records of others: the records are what they are said to be, the scorer
counts what its definitions say, and the diagnosis answers short ones.

Levels are those of campaigns (`make blind`); here stands what breaks with less than 1 %.
"""

import os

import numpy as np
import pytest
from injector.build import Case, Hidden
from injector.cases import grid, make
from injector.many import GROUPS, groups_in_turn
from injector.nuisances import NUISANCES, neutral_names
from injector.signatures import axes_of
from injector.unseen import AXES
from real_records import real_cases
from runner import answer_case
from scorer.judge import open_truth
from scorer.real import judge_real
from scorer.spans import Spanned, axes_shares, names_share
from scorer.wide import judge_wide
from wide import line_of, wide_numbers

_SEED = 52000
DATA = os.environ.get("HDBENCH_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="HDBENCH_DATA is not set")


def answered(cases):
    """(truth, entry) of each case; no record may crash."""
    out = []
    for case in cases:
        sealed, entry = answer_case(case, with_oracle=False)
        assert "crashed" not in entry, entry["crashed"]
        out.append((open_truth(sealed, entry["seal"]), entry))
    return out


def several(seed, *names, record="quick"):
    hidden = tuple(Hidden(name, "physical") for name in names)
    return Case(f"quick-T-{seed}", "T", record, seed=seed, hidden=hidden, note="3")


def pair(seed, *names, record="quick"):
    hidden = tuple(Hidden(name, "d40") for name in names)
    return [
        Case(f"quick-W-{seed}-{note}", "W", record, seed=seed, hidden=hidden, note=note)
        for note in ("plain", "rough")
    ]


def test_all_pairs_of_groups_come_up():
    seen = set()
    for size, groups in groups_in_turn(np.random.default_rng(1), 60):
        assert sorted(groups) == sorted(GROUPS)
        seen |= {frozenset((a, b)) for a in groups[:size] for b in groups[:size] if a != b}
    assert len(seen) == len(GROUPS) * (len(GROUPS) - 1) // 2


def test_several_causes_have_ten_sigma_each_and_groups_of_their_own():
    case = several(_SEED, "coulomb-friction", "presliding", "ripple-harmonic", "zero-step")
    truth = make(case).truth
    assert len(truth["hidden"]) == 3
    for effect in truth["hidden"]:
        assert effect["d"] >= 10.0
        same = {name for name, value in effect["alike"].items() if value < 0.01}
        assert not same & {other["name"] for other in truth["hidden"] if other is not effect}


def test_a_pair_hides_the_same_and_differs_by_its_nuisances():
    plain, rough = (make(case) for case in pair(_SEED + 1, "viscous-friction"))
    assert plain.truth["hidden"][0]["size"] == rough.truth["hidden"][0]["size"]
    assert plain.truth["nuisances"] == rough.truth["nuisances"]
    assert not plain.truth["neutral"]
    assert set(rough.truth["neutral"]) <= set(neutral_names(NUISANCES))
    assert {"time_s", "torque_nm", "motor_velocity_rad_s"} <= set(rough.columns)
    for made in (plain, rough):
        assert np.all(np.diff(made.columns["time_s"]) > 0.0)
        assert len({len(values) for values in made.columns.values()}) == 1


def test_every_nuisance_alone_makes_a_record(monkeypatch):
    from injector import nuisances, rough

    for name in NUISANCES:
        drawn = {name: nuisances._draw(name, np.random.default_rng(3))}
        monkeypatch.setattr(rough, "draw_nuisances", lambda rng, drawn=drawn: drawn)
        made = make(pair(_SEED + 2)[1])
        assert np.isfinite(made.columns["torque_nm"]).all(), name
        assert np.all(np.diff(made.columns["time_s"]) > 0.0), name


def test_without_nuisances_an_effect_keeps_its_sigmas(monkeypatch):
    from injector import rough

    monkeypatch.setattr(rough, "draw_nuisances", lambda rng: {})
    truth = make(pair(_SEED + 3, "coulomb-friction")[1]).truth
    assert truth["hidden"][0]["d"] == pytest.approx(40.0, rel=0.02)


def test_the_axis_of_an_unseen_effect_spans_it_and_another_does_not():
    rights = others = 0
    for case in [case for case in grid(parts="U") if case.record == "compact"][:2]:
        made = make(case)
        shape = made.truth["hidden"][0]["shape"]
        spanned = Spanned(made.torques[0], made.scene.baseline(), axes_of(made.scene))
        domains = [AXES[axis] for axis in shape["axes"]]
        bursts = shape["recipe"] == "bursts"
        domains = ["motor-order", *domains] if shape["recipe"] == "order" else domains or ["time"]
        entry = {"domain": domains[0], "location": shape.get("order", 0.0),
                 "second_domain": domains[1] if len(domains) > 1 else None}  # fmt: skip
        rights += max(axes_shares(spanned, [entry], bursts).values()) >= 0.95
        wrong = {"domain": "motor-order", "location": 17.3}
        others += max(axes_shares(spanned, [wrong], bursts).values()) >= 0.95
    assert rights == 2
    assert others == 0


def test_two_names_span_what_is_made_of_both():
    axis = np.linspace(-1.0, 1.0, 2000)
    axes = {"time": axis, "motor-angle": 50.0 * axis}
    spanned = Spanned(axis + np.sign(axis), np.ones((2000, 1)), axes)
    signatures = {"a": axis[:, None], "b": np.sign(axis)[:, None], "c": np.cos(9 * axis)[:, None]}
    share, names, each = names_share(spanned, signatures)
    assert share == pytest.approx(1.0)
    assert sorted(names) == ["a", "b"]
    assert each["c"] < 0.1


def told(*names, left=(), minor=(), **more):
    def cause(name):
        return {"name": name, "group": [name], "rivals": [], "parameters": {}}

    answer = {
        "verdict": "named", "causes": list(map(cause, names)), "minor": list(map(cause, minor)),
        "unexplained": [{"domain": d, "location": 0.0, "size_nm": s} for d, s in left], **more,
    }  # fmt: skip
    return {"key": "k", "seconds": 1.0, "cpu_s": 1.0, "answer": answer}


def several_truth(*names, part="T", **more):
    hidden = [
        {"name": name, "alike": {name: 0.0}, "shape": {}, "agrees": False, "d": 20.0}
        for name in names
    ]
    return {"key": "k", "part": part, "record": "compact", "sigma_nm": 0.05, "hidden": hidden,
            "note": "3", "seconds": 28.0, **more}  # fmt: skip


BOTH = several_truth("coulomb-friction", "zero-step")


def test_a_record_is_right_where_all_is_named_and_nothing_false():
    assert judge_wide(BOTH, told("coulomb-friction", "zero-step")).right
    assert judge_wide(BOTH, told("coulomb-friction", minor=["zero-step"])).right
    missed = judge_wide(BOTH, told("coulomb-friction"))
    assert missed.found == (True, False)
    assert not missed.right
    more = judge_wide(BOTH, told("coulomb-friction", "zero-step", "creep"))
    assert more.false_causes == ("creep",)
    assert not more.right
    left = told("coulomb-friction", "zero-step", left=[("time", 1.0)])
    assert not judge_wide(BOTH, left).right


def test_a_rest_above_the_noise_has_to_be_told():
    silent = told("coulomb-friction", extended={"heldout_rms_nm": 0.12})
    assert not judge_wide(BOTH, silent).rest_told
    named = told("coulomb-friction", left=[("time", 0.1)], extended={"heldout_rms_nm": 0.12})
    assert judge_wide(BOTH, named).rest_told
    assert judge_wide(BOTH, told("coulomb-friction", extended={"heldout_rms_nm": 0.052})).rest_told
    own = {"heldout_rms_nm": 0.12, "noise_rms_nm": 0.05, "told": [0]}
    assert judge_wide(BOTH, told("coulomb-friction", rest=own)).rest_told
    assert not judge_wide(BOTH, told("coulomb-friction", rest={**own, "told": []})).rest_told


def test_a_nuisance_under_its_own_name_counts_neither_way():
    clean = several_truth(part="W", neutral=["gain-error"], nuisances={"gain": {}})
    clean["note"] = "rough"
    assert not judge_wide(clean, told("gain-error")).alarm
    assert judge_wide(clean, told("gain-error", "creep")).alarm


def test_known_things_of_a_real_record_are_looked_up():
    truth = {
        "named": ["coulomb-friction", "asymmetric-friction"], "must_not": ["encoder-slip"],
        "parameters": {"coulomb_nm": [2.0, 0.1]}, "orders": {"12": [0.125, 0.003]},
    }  # fmt: skip
    entry = told("coulomb-friction", "direction-asymmetry", "encoder-slip", "cogging")
    causes = entry["answer"]["causes"]
    causes[0]["parameters"] = {"coulomb_nm": {"value": 2.2, "std": 0.05}}
    causes[3]["parameters"] = {"order": {"value": 12.01, "std": 0.01},
                               "amplitude_nm": {"value": 0.127, "std": 0.001}}  # fmt: skip
    verdict = judge_real(truth, {**entry, "torque_rms_nm": 1.0})
    assert all(verdict.named.values())
    assert verdict.orders == {"12": (True, 0.127)}
    assert verdict.forbidden == ("encoder-slip",)
    assert verdict.false_causes == ("encoder-slip",)
    assert verdict.parameters["coulomb_nm"] == (2.2, 0.05, True, True)


def test_a_rough_log_is_answered_and_scored():
    rows = answered(pair(_SEED + 11, "coulomb-friction")[1:])
    assert judge_wide(*rows[0]).answered, line_of(*rows[0])
    assert "W_named_rough" in wide_numbers(rows)


@pytest.mark.campaign
def test_short_records_of_each_part_are_answered_and_scored():
    unseen = [Case(f"quick-U-{k}", "U", "compact", seed=_SEED + 20 + k,
                   hidden=(Hidden("unseen", "d20"),)) for k in range(2)]  # fmt: skip
    rows = answered(
        [
            several(
                _SEED + 10, "ripple-harmonic", "viscous-friction", "zero-step", record="compact"
            ),
            *pair(_SEED + 11, "coulomb-friction", record="compact"),
            *unseen,
        ]
    )
    lines = "\n".join(line_of(*row) for row in rows)
    verdicts = [judge_wide(*row) for row in rows]
    assert all(verdict.answered for verdict in verdicts), lines
    assert all(verdict.alarm for verdict in verdicts[:2]), lines
    # three causes of physical size and one of 40 sigma without nuisances
    assert sum(map(sum, (verdicts[0].found, verdicts[1].found))) >= 3, lines
    numbers = wide_numbers(rows)
    assert {"T_named", "W_named_rough", "U_right"} <= set(numbers)


@pytest.mark.campaign
@needs_data
def test_a_record_of_others_is_read_and_judged():
    case = next(case for case in real_cases() if "cogging" in case.record)
    ((truth, entry),) = answered([case])
    verdict = judge_real(truth["known"], entry)
    assert verdict.answered, line_of(truth, entry)
    if "rest" in entry["answer"]:
        # engines that tell what is left know poles from rolling elements too
        assert not verdict.forbidden, line_of(truth, entry)
