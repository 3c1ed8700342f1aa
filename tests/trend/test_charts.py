"""Charts of one history: the published examples, the false alarms, steps and drift."""

import numpy as np
import pytest
import trend_campaign as campaign

from hdbench.trend.charts import _ewma, control_chart, find_limits, study_history


def study(values, own=None, months=None, probability=0.05):
    n = len(values)
    return study_history(
        np.asarray(values, dtype=float),
        np.zeros(n) if own is None else own,
        np.arange(n, dtype=float) if months is None else months,
        probability=probability,
        draw=np.random.default_rng(0),
    )


def test_individuals_of_the_nist_handbook():
    # NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.2: flow rates of ten batches; the page
    # prints mean 50.81, mean moving range 1.8778, limits 55.8041 and 45.8159
    values = np.array([49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1])
    chart = control_chart(values, np.zeros(10))
    assert round(chart.center, 4) == 50.81
    assert round(float(chart.moving_range.mean()), 4) == 1.8778
    assert {round(chart.center + 3.0 * std, 4) for std in chart.stds} == {55.8041}
    assert {round(chart.center - 3.0 * std, 4) for std in chart.stds} == {45.8159}


def test_ewma_of_the_nist_handbook():
    # 6.3.2.4: target 50, std 2.0539, weight .3; limits 52.5884 and 47.4115 (cut, not rounded)
    values = np.array(
        [
            *(52.0, 47.0, 53.0, 49.3, 50.1, 47.0, 51.0, 50.1, 51.2, 50.5),
            *(49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1),
        ]
    )
    printed = [50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33]
    printed += [50.11, 49.36, 49.52, 50.05, 49.38, 49.92, 50.73, 51.23, 51.94, 51.99]
    (ewma,), (stds,) = _ewma(values[None], np.array([50.0]), np.full((1, 20), 2.0539), 0.3)
    assert np.round(ewma, 2).tolist() == printed
    upper, lower = (50.0 + sign * 3.0 * stds[-1] for sign in (1.0, -1.0))
    assert round(float(upper), 4) == 52.5884
    assert int(lower * 1e4) / 1e4 == 47.4115
    assert np.all((lower < ewma) & (ewma < upper))


def test_a_stable_history_alarms_as_often_as_stated():
    # 5 % of 400: 20 +- 4.4; the band is 4 std wide on either side, 6e-5 of chance to leave it
    hits = round(400 * campaign.false_alarms(campaign._none, 400))
    assert 2 < hits < 38


def test_a_step_of_two_stds_is_found_within_eight_runs():
    # wanted: 90 % at least; measured on 1 000: 96 %. 88 of 100 leaves 4 std of chance below 96 %
    assert campaign.found_steps(100) >= 0.88


@pytest.mark.parametrize("own", [np.zeros(40), np.where(np.arange(40) % 2, 3.0, 0.1)])
def test_limits_hold_for_all_charts_together(own):
    draw = np.random.default_rng(3)
    chart = control_chart(draw.normal(size=40) * np.hypot(1.0, own), own)
    wide, narrow = (find_limits(chart, own, p, np.random.default_rng(0)) for p in (0.01, 0.2))
    assert wide.individuals > narrow.individuals
    assert wide.moving_range > narrow.moving_range
    assert wide.ewma > narrow.ewma
    assert wide.step > narrow.step


def test_own_uncertainties_widen_the_limits_of_their_runs_alone():
    draw = np.random.default_rng(1)
    own = np.where(np.arange(60) % 3 == 0, 2.0, 0.3)
    chart = control_chart(draw.normal(size=60) * np.hypot(0.5, own), own)
    # the scatter between runs is recovered: its own std from 60 ranges is some 20 %
    assert 0.2 < chart.between_std < 0.8
    assert np.allclose(chart.stds, np.hypot(chart.between_std, own))


def test_an_uncertainty_common_to_all_runs_does_not_hide_what_they_say():
    values = np.random.default_rng(2).normal(size=40)
    alone, common = (control_chart(values, own) for own in (np.zeros(40), np.full(40, 10.0)))
    assert np.allclose(alone.stds, common.stds)
    assert common.between_std == 0.0


def test_a_run_that_states_no_uncertainty_is_as_good_as_the_others():
    # they scatter less than the others say: their own scatter alone would be zero
    values, own = 0.1 * np.random.default_rng(3).normal(size=12), np.full(12, 0.5)
    own[::3] = 0.0
    chart, limits = study(values, own).chart, study(values, own).limits
    assert np.allclose(chart.stds, chart.stds[0])
    assert chart.stds[0] > 0.0
    assert np.isfinite(limits.individuals)


def test_a_step_is_placed_sized_and_given_its_probability():
    values = np.random.default_rng(5).normal(size=60)
    values[25:] += 3.0
    found = study(values)
    (change,) = found.changes
    assert change.step.earliest <= 25 <= change.step.latest
    assert abs(change.step.index - 25) <= 2
    assert change.step.probability > 0.99
    low, high = change.size.interval(0.999)
    assert low < 3.0 < high
    assert [signal.chart for signal in found.signals].count("step") == 1


def test_two_steps_are_found_and_a_drift_is_no_staircase():
    draw = np.random.default_rng(6)
    values = draw.normal(size=60)
    values[20:40] += 4.0
    assert [change.step.index for change in study(values).changes] == pytest.approx([20, 40], abs=1)
    months = np.arange(60) / 4.0
    drifting = study(draw.normal(size=60) + 0.5 * months, months=months)
    assert drifting.changes == ()
    assert drifting.signals
    low, high = drifting.drift_per_month.interval(0.999)
    assert low < 0.5 < high


def test_the_interval_of_the_drift_covers():
    draw = np.random.default_rng(7)
    months = np.sort(draw.uniform(0.0, 12.0, size=20))
    hits = 0
    for _ in range(200):
        low, high = study(draw.normal(size=20) + months, months=months).drift_per_month.interval()
        hits += low < 1.0 < high
    # 95 % of 200: 190 +- 3.1; where a chance step was taken instead of the line it is a little less
    assert hits >= 176


@pytest.mark.parametrize("values", [[1.0] * 5, [1.0] * 30, np.arange(5.0)])
def test_too_few_runs_or_no_scatter_give_no_limits(values):
    found = study(values)
    assert found.limits is None
    assert found.signals == ()
    assert found.why_not
