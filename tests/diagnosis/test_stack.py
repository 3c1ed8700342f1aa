"""Records of a stack add where they share a cause, and stay apart in all else."""

from dataclasses import fields, replace

import numpy as np
import pytest
from discovery_records import fitted, swinging, term, with_terms

from hdbench.diagnosis.discovery.lines import plan_scans, scan_looks, scan_power
from hdbench.diagnosis.discovery.moments import inverse
from hdbench.diagnosis.discovery.stack import coefficients_of, piece_fit, stack_fits, stacked_causes
from hdbench.diagnosis.discovery.term import Term, term_columns
from hdbench.model import catalogue

ORDER = 6.0


def line(size, phase=0.0):
    return lambda time, angle, speed: size * np.cos(ORDER * angle + phase)


@pytest.fixture(scope="module")
def fits():
    return [fitted(swinging(n, line(0.03), seed)) for seed, n in enumerate((3000, 4000))]


@pytest.fixture
def stack(fits):
    return stack_fits(fits)


def causes(stack, referenced=True):
    return stacked_causes(catalogue().values(), len(stack.record.records), referenced=referenced)


def test_baselines_of_a_stack_are_those_of_its_records(fits, stack):
    pieces = [piece_fit(stack, number)[0] for number in range(2)]
    for one, piece in zip(fits, pieces, strict=True):
        assert [p.name for p in piece.parts] == [p.name for p in one.parts]
        std = np.sqrt(np.diag(inverse(one.information)))
        for part in range(len(one.parts)):
            off = np.abs(piece.linear(part) - one.linear(part)) * one.parts[part].scale
            # the noise is settled from other first ones: well below the standard deviations
            assert np.all(off < 0.5 * std[one.flat(part)])


def test_inverse_is_the_transpose_of_the_transform_of_a_stack(stack):
    rng = np.random.default_rng(0)
    column, row = rng.standard_normal(len(stack.record)), rng.standard_normal(stack.bands.size)
    there = float(stack.bands.transform(column[:, None])[0] @ row)
    assert there == pytest.approx(float(column @ stack.bands.inverse(row)), rel=1e-9)


def test_a_shared_cause_is_weighed_by_the_information_of_each_record(fits, stack):
    shared = causes(stack)["ripple-harmonic"].whole
    with_terms(stack, Term(shared, {"order": ORDER}), rounds=4)
    values, weights = [], []
    for one in fits:
        own, part = with_terms(one.copy(), term("ripple-harmonic", order=ORDER), rounds=4)
        values.append(own.linear(part))
        weights.append(len(own.record) / np.mean(own.spectrum.power))
    mean = np.average(values, axis=0, weights=weights)
    # the noise of each record is fitted: some per cent of a standard deviation of 0.8 mN m
    np.testing.assert_allclose(stack.linear(len(stack.parts) - 1), mean, atol=2e-4)


def test_a_cause_of_each_record_is_fitted_to_it_alone(fits, stack):
    each = causes(stack, referenced=False)["ripple-harmonic"]
    _, part = with_terms(stack, Term(each, {"order": ORDER}), rounds=4)
    apart = stack.linear(part).reshape(2, 2)
    for one, found in zip(fits, apart, strict=True):
        own, place = with_terms(one.copy(), term("ripple-harmonic", order=ORDER), rounds=4)
        np.testing.assert_allclose(found, own.linear(place), atol=2e-4)


@pytest.mark.parametrize("passed", [(1.0, 1.0), (0.05, 0.1)])
def test_columns_of_a_piece_are_those_of_the_record(passed):
    records = [
        replace(swinging(n, line(0.03), seed), motion_passed=share)
        for seed, (n, share) in enumerate(zip((3000, 4000), passed, strict=True))
    ]
    stack = stack_fits([fitted(record) for record in records])
    every = causes(stack)
    tone = Term(every["structural-tone"], {"frequency_hz": 20.0})
    with_terms(stack, Term(every["viscous-friction"], {}), tone, rounds=1)
    for number, at in enumerate(coefficients_of(stack)):
        piece, origin = piece_fit(stack, number)
        np.testing.assert_allclose(piece.residual, stack.residual[at])
        modelled = sum(
            term_columns(piece.parts[i].term, piece.record) @ piece.linear(i)
            for i in range(len(origin))
            if piece.parts[i].term is not None
        )
        baseline = sum(
            piece.coefficients[piece.flat(i)] @ piece.rows[piece.flat(i)]
            for i in range(len(origin))
            if piece.parts[i].term is None
        )
        left = piece.measured - baseline - piece.bands.transform(modelled[:, None])[0]
        np.testing.assert_allclose(left, piece.residual, atol=1e-9)


def test_a_step_is_in_one_record_alone(stack):
    step = causes(stack)["zero-step"]
    time = float(stack.record.motion.time_s[3500])
    _, part = with_terms(stack, Term(step, {"step_time_s": time}), rounds=1)
    assert part not in piece_fit(stack, 0)[1]
    piece, origin = piece_fit(stack, 1)
    own = piece.term(origin.index(part)).shape["step_time_s"]
    assert own == pytest.approx(float(stack.record.records[1].motion.time_s[500]))


def test_angles_have_one_zero_only_where_the_ripple_says_so(fits):
    assert stack_fits(fits).record.referenced
    turned = swinging(3000, lambda time, angle, speed: 0.4 * np.cos(2 * angle + 2.0), 5)
    assert not stack_fits([fits[0], fitted(turned)]).record.referenced


def test_lines_at_whole_orders_add_in_phase_where_angles_have_one_zero(fits):
    stack = stack_fits(fits)
    every = causes(stack)
    looks = scan_looks(stack, plan_scans(stack.record), every)
    best = max((x for x in looks if x.dof == 2), key=lambda x: x.statistic)
    assert best.term.shape == {"order": ORDER}
    alone = []
    for one in fits:
        looks = scan_looks(one, plan_scans(one.record), catalogue())
        alone.append(max(looks, key=lambda x: x.statistic).statistic)
    # one phase: the statistics add, but for what the noise of each had taken of it
    assert best.statistic == pytest.approx(sum(alone), rel=0.15)
    assert best.statistic > max(alone)


def test_statistics_of_a_line_add_over_records_of_different_rate():
    fast, slow = fitted(swinging(4000, line(0.05), 1)), fitted(swinging(3000, line(0.05), 2))
    slow = fitted(thinned(slow.record))
    stack = stack_fits([fast, slow])
    (scan,) = (s for s in plan_scans(stack.record) if s.domain == "motor-order")
    statistic, amplitude = scan_power(stack, scan)
    at = int(np.argmin(np.abs(scan.transform.grid - ORDER)))
    at = at - 2 + int(np.argmax(statistic[at - 2 : at + 3]))
    # some 0.9 is left at a point of the grid beside the line
    assert amplitude[at] == pytest.approx(0.05, rel=0.1)


def thinned(record):
    """Return every second sample of a record."""

    def half(values):
        return values[::2] if isinstance(values, np.ndarray) else values

    motion = replace(
        record.motion,
        **{f.name: half(getattr(record.motion, f.name)) for f in fields(record.motion)},
    )
    own = {
        f.name: half(getattr(record, f.name))
        for f in fields(record)
        if f.init and f.name != "prior_nm"
    }
    own |= {"motion": motion, "period_s": 2.0 * record.period_s, "prior_nm": record.prior_nm}
    return replace(record, **own)
