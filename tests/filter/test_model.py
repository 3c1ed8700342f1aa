"""Filter models: presets, files, stored results."""

import json
import math
from dataclasses import replace

import pytest
from kernel_models import filter_model, order_block

from hdbench.errors import DataError
from hdbench.filter import (
    PRESETS,
    OscillatorBlock,
    SlowBlock,
    build_filter_model,
    load_filter_model,
    preset,
)
from hdbench.model.bench import BenchModel
from hdbench.model.definition import CauseTerm
from hdbench.model.modelfile import model_dict

BLOCK = OscillatorBlock(2.0, "ripple", 0.1)
MODEL = filter_model((BLOCK,), 1.0, inertia=0.01, angle=True, provenance={"orders": "a test"})


def loaded(bench, folder, text):
    file = folder / "own.json"
    file.write_text(text, encoding="utf-8", errors="surrogateescape")
    return load_filter_model(str(file), bench)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_integrate_the_velocity_and_say_where_they_are_from(bench, name):
    """Their numbers are held against the report's equations in test_recursion."""
    found = load_filter_model(name, bench)
    assert not found.use_measured_angle
    assert found.provenance


@pytest.mark.parametrize(("name", "near"), [("report6", "report-6"), ("tuned", "report-")])
def test_an_unknown_model_names_the_presets_and_the_nearest(bench, name, near):
    with pytest.raises(DataError, match="report-a1, report-a2, report-6") as caught:
        load_filter_model(name, bench)
    assert near in caught.value.fix
    with pytest.raises(DataError):
        preset(name, bench)


@pytest.mark.parametrize("gain", [None, 6.6, -6.6])
def test_a_model_file_gives_the_same_model_back(bench, tmp_path, gain):
    blocks = (BLOCK, OscillatorBlock(0.1, "ripple", 1 / 3))
    first = replace(MODEL, torque_gain_nm_per_v=gain, blocks=blocks)
    assert loaded(bench, tmp_path, json.dumps(first.to_dict(), allow_nan=False)) == first


def stored(order, **changes):
    """Return a block as it stands in a file."""
    return {"order": order, "role": "ripple", "process_noise": 1, **changes}


BAD_KEYS = {
    **{"schema": "hdbench/ripple/1", "surplus": 1, "use_measured_angle": 1, "name": 5},
    **{"measurement_noise": 0, "provenance": {"a": 1}, "torque_gain_nm_per_v": 0.0},
}


@pytest.mark.parametrize(
    ("key", "value", "place"),
    [
        *((key, value, key) for key, value in BAD_KEYS.items()),
        *(("gear_ratio", value, "gear_ratio") for value in (None, "100", True, -100.0)),
        ("measurement_noise", ..., "measurement_noise: found nothing"),
        *(("blocks", {}, "blocks"), ("blocks", [], "blocks")),
        ("blocks", [{"order": 2.0}], "blocks.0"),
        ("blocks", [stored(0)], "order"),
        *(("blocks", [stored(2, role=role)], "role") for role in ("other", ["ripple"])),
        ("blocks", [stored(2)] * 2, "order 2.0"),
        ("blocks", [stored(i + 1) for i in range(17)], "17 blocks"),
    ],
)
def test_a_bad_model_file_names_the_place(bench, tmp_path, key, value, place):
    body = {**MODEL.to_dict(), key: value}
    text = json.dumps({key: value for key, value in body.items() if value is not ...})
    with pytest.raises(DataError, match=rf"^\S*own\.json(.|\n)*{place}"):
        loaded(bench, tmp_path, text)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_numbers_out_of_their_domain_make_no_model(value):
    with pytest.raises(ValueError, match="order"):
        OscillatorBlock(order=value, role="ripple", process_noise=1.0)
    with pytest.raises(ValueError, match="process_noise"):
        OscillatorBlock(order=2.0, role="ripple", process_noise=value)
    for field in ("measurement_noise", "gear_ratio", "differentiator_time_constant_s"):
        with pytest.raises(ValueError, match=field):
            replace(MODEL, **{field: value})


def bench_model(**changes):
    baseline = {"ripple": [{"order": 2.0}, {"order": 4.0}]}
    body = {"schema": "hdbench/model/1", "baseline": baseline, "causes": []}
    return json.dumps({**body, **changes})


def test_an_extended_bench_model_gives_its_orders_as_blocks(bench, tmp_path):
    causes = [
        {"name": "ripple-harmonic", "parameters": {"order": {"value": 7.9, "std": 0.01}}},
        {"name": "wave-generator-eccentricity", "parameters": {}},
        {"name": "angular-misalignment", "parameters": {}},
        {"name": "mains-hum", "parameters": {"frequency_hz": {"value": 60.0}}},
        {"name": "structural-tone", "parameters": {"frequency_hz": {"value": 31.0}}},
        {"name": "misalignment", "parameters": {}},
        {"name": "bearing-defect", "parameters": {"order": {"value": 3.1}}},
        {"name": "cogging", "parameters": {"order": {"value": 12.0}}},
    ]
    found = loaded(bench, tmp_path, bench_model(causes=causes))
    ripple = {2.0, 4.0, 7.9, 1.0, 3.1, 2 * 3.1, 3 * 3.1, 12.0, 24.0, 36.0, 72.0}
    for role, orders in (("ripple", ripple), ("misalignment", {0.01, 0.02})):
        found_orders = {b.order for b in found.blocks if b.role == role and not b.frequency_hz}
        assert found_orders == orders
    assert found.use_measured_angle
    assert found.name == "own"
    assert [b.frequency_hz for b in found.blocks if b.frequency_hz] == [60.0]
    assert "mains-hum" in found.provenance["60 Hz"]
    assert "no block" in found.provenance["cause structural-tone"]
    assert "ripple-harmonic" in found.provenance["order 7.9"]


def test_a_model_that_the_diagnosis_saved_becomes_a_filter(bench, tmp_path):
    found = CauseTerm("ripple-harmonic", {"order": 7.9}, (0.1, 0.05), None)
    extended = BenchModel(0.0, 1e-4, ((2.0, 0.4, 0.6),), (0.9, 0.3)).with_cause(found)
    text = json.dumps(model_dict(extended, profile=None, provenance={}))
    blocks = loaded(bench, tmp_path, text).blocks
    assert sorted(block.order for block in blocks) == [0.01, 2.0, 7.9]


@pytest.mark.parametrize(
    "text",
    [
        *("", "[1]", "{", '{"schema": NaN}', "\udcff"),
        bench_model(causes={}),
        bench_model(causes=[3]),
        bench_model(causes=[{"name": "ripple-harmonic", "parameters": []}]),
        bench_model(causes=[{"name": "ripple-harmonic", "parameters": {"order": {"value": "7"}}}]),
        bench_model(causes=[{"name": "ripple-harmonic", "parameters": {"order": {"value": -7}}}]),
        bench_model(causes=[{"name": "mains-hum", "parameters": {}}]),
        bench_model(baseline=[]),
        bench_model(baseline={"ripple": [2.0]}),
        bench_model(causes=[{"name": "x", "parameters": {"order": 10 + i}} for i in range(20)]),
    ],
)
def test_a_broken_file_and_a_bad_bench_model_are_refused(bench, tmp_path, text):
    with pytest.raises(DataError, match=r"^\S*own\.json"):
        loaded(bench, tmp_path, text)


RIPPLE = {
    "schema": "hdbench/ripple/1",
    "ripple": [{"order": 2.0}, {"order": 7.9}],
    "filter": {"measurement_noise": 0.0025, "process_noise": 1e-4},
    "run": "20260101-ripple",
}
MISALIGNMENT = {
    "schema": "hdbench/misalignment/1",
    "filter": {"order": 0.01, "process_noise": 0.2, "measurement_noise": 2.0},
}
CALIBRATION = {
    "schema": "hdbench/calibration/1",
    "gain_nm_per_v": {"value": 6.7, "std": 0.1, "dof": 7},
}


def test_results_feed_orders_noise_and_gain_and_say_so(bench):
    base = preset("report-6", bench)
    results = {"ripple": RIPPLE, "misalignment": MISALIGNMENT, "calibration": CALIBRATION}
    found = build_filter_model(base, **results)
    roles = [(b.order, b.role) for b in found.blocks]
    assert roles == [(2.0, "ripple"), (7.9, "ripple"), (0.01, "misalignment")]
    assert found.measurement_noise == 0.0025
    assert [b.process_noise for b in found.blocks[:2]] == [1e-4, 1e-4]
    # Q/R = 0.2 / 2 is kept: products and quotients of doubles
    assert found.blocks[2].process_noise == pytest.approx(0.1 * 0.0025, rel=1e-12)
    assert found.torque_gain_nm_per_v == 6.7
    assert found.use_measured_angle
    assert not found.name.startswith("report-")
    assert "20260101-ripple" in found.provenance["ripple blocks, measurement_noise"]
    assert "sha256" in found.provenance["torque_gain_nm_per_v"]


def test_a_block_that_no_result_gives_keeps_its_selectivity(bench):
    base = preset("report-6", bench)
    first = build_filter_model(build_filter_model(base, misalignment=MISALIGNMENT), ripple=RIPPLE)
    second = build_filter_model(build_filter_model(base, ripple=RIPPLE), misalignment=MISALIGNMENT)
    for fed in (first, second):
        block = next(b for b in fed.blocks if b.role == "misalignment")
        # the order of feeding must not matter beyond rounding
        assert block.process_noise / fed.measurement_noise == pytest.approx(0.1, rel=1e-12)
    noise = {"ripple": [{"order": 2.0}], "filter": {"measurement_noise": 0.01}}
    only_r = build_filter_model(base, ripple=noise)
    # Q/R of the profile, 1000 and 0.05, kept: products and quotients of doubles
    ratios = [b.process_noise / only_r.measurement_noise for b in only_r.blocks]
    assert ratios == pytest.approx([1000.0, 0.05], rel=1e-12)


def test_a_tuned_base_keeps_its_noise_and_takes_orders_only():
    slow = (SlowBlock("random-walk", noise_per_s=0.1),)
    blocks = (order_block(2.0, 1e-9), order_block(0.01, 1e-6, "misalignment"))
    prior = {"order_prior_std_nm": 4.0, "slow_prior_std_nm": 40.0}
    tuned = replace(MODEL, blocks=blocks, slow=slow, **prior)
    fed = build_filter_model(tuned, ripple=RIPPLE, misalignment=MISALIGNMENT)
    assert fed.measurement_noise == tuned.measurement_noise
    ripple = (order_block(2.0, 1e-9), order_block(7.9, 1e-9))
    assert fed.blocks == (*ripple, order_block(0.01, 1e-6, "misalignment"))
    assert fed.slow == tuned.slow


def test_without_results_the_model_stays_itself(bench):
    base = preset("report-6", bench)
    assert build_filter_model(base, ripple=None, misalignment=None, calibration=None) is base


def test_feeding_twice_does_not_grow_the_name(bench):
    once = build_filter_model(preset("report-a1", bench), calibration=CALIBRATION)
    twice = build_filter_model(once, misalignment=MISALIGNMENT)
    assert twice.name == once.name
    assert [b.order for b in twice.blocks] == [2.0, 4.0, 0.01]


@pytest.mark.parametrize(
    ("kind", "result"),
    [
        *(("ripple", {}), ("misalignment", {}), ("calibration", {})),
        *(("ripple", {"ripple": lines}) for lines in ([], [{"order": 0.0}], ["2"])),
        ("ripple", {"ripple": [{"order": 2.0}, {"order": 2.0}]}),
        ("ripple", {**RIPPLE, "filter": {"measurement_noise": math.nan}}),
        ("misalignment", {"filter": {"order": True}}),
        ("calibration", {"gain_nm_per_v": {"value": 0.0}}),
    ],
)
def test_results_that_lack_their_numbers_are_refused(bench, kind, result):
    with pytest.raises(DataError):
        build_filter_model(preset("report-6", bench), **{kind: result})
