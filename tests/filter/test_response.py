"""Response of a filter, by algebra and by the running filter."""

import math

import numpy as np
import pytest
from kernel_models import filter_model
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, solve_discrete_are
from tuning_traces import tuned_like

from hdbench.errors import DataError
from hdbench.filter import OnlineFilter, OscillatorBlock, preset
from hdbench.filter.response import filter_response, inject, steady_filter

PERIOD = 1e-3

# |H(0)| from measured to filtered torque: the acceptance's figures, three digits
AT_ZERO = [
    *(("report-a1", 50.0, 0.141), ("report-a1", 156.0, 0.531)),
    *(("report-a2", 50.0, 0.061), ("report-a2", 156.0, 0.206)),
    *(("report-6", 50.0, 0.088), ("report-6", 156.0, 0.331)),
]


def models(bench):
    return [*(preset(n, bench) for n in ("report-a1", "report-a2", "report-6")), tuned_like()]


@pytest.mark.parametrize(("name", "velocity", "wanted"), AT_ZERO)
def test_the_share_of_slow_torque_that_the_presets_pass_in_two_ways(bench, name, velocity, wanted):
    model = preset(name, bench)
    found = filter_response(model, velocity, PERIOD)
    # three printed digits, the last one to half a unit and a little
    assert found.passed[0].gain == pytest.approx(wanted, abs=6e-4)
    assert inject(model, velocity, PERIOD, [0.0])[0].measured == pytest.approx(wanted, abs=6e-4)


@pytest.mark.parametrize("velocity", [40.0, -156.0])
def test_injection_agrees_with_algebra_for_every_model(bench, velocity):
    for model in models(bench):
        for probe in inject(model, velocity, PERIOD, [0.5, 2.0, 10.0, 77.7], samples=30_000):
            # what the slowest state has not forgotten in 15 s: below its gain of thousandths
            assert probe.measured == pytest.approx(probe.algebra, abs=4e-3), model.name


def test_every_block_is_a_notch_and_its_width_is_where_half_power_comes_back(bench):
    model = tuned_like()
    found = filter_response(model, 100.0, PERIOD)
    steady = steady_filter(model, 100.0, PERIOD)
    for block, notch in zip(model.blocks, found.notches, strict=True):
        assert notch.frequency_hz == pytest.approx(block.order * 100.0 / (2.0 * math.pi))
        assert notch.depth_db < -100.0
        assert notch.lower_hz < notch.frequency_hz < notch.upper_hz
        edges = np.abs(steady.transfer(np.array([notch.lower_hz, notch.upper_hz])))
        # bisection to a millionth of the offset
        assert_allclose(edges, math.sqrt(0.5), rtol=1e-4)
    # nothing of the report's order 2 comes back between its notches at this speed
    assert filter_response(preset("report-a1", bench), 50.0, PERIOD).notches[0].width_hz is None


def test_the_width_of_a_lone_notch_is_its_gain():
    # one order in white noise: closed loop 1 - (P/S) rotation, half power at P / (2 pi S dt)
    model = filter_model((OscillatorBlock(2.0, "ripple", 1e-9),), 1.0, order_prior_std_nm=1.0)
    p = math.sqrt(2.0 * 1e-9)  # P^2 / (2 R) = q: a quadrature is seen half of the time
    found = filter_response(model, 100.0, PERIOD).notches[0]
    # to first order in the gain, 5e-5
    assert found.width_hz == pytest.approx(p / (2.0 * math.pi * PERIOD), rel=1e-2)


def test_the_noise_gain_is_the_mean_square_of_the_transfer_and_of_the_output(bench):
    rng = np.random.default_rng(0)
    n = 60_000
    for model in models(bench)[::3]:
        found = filter_response(model, 156.0, PERIOD)
        hz = (np.arange(1 << 15) + 0.5) * 0.5 / PERIOD / (1 << 15)
        power = np.abs(steady_filter(model, 156.0, PERIOD).transfer(hz)) ** 2
        # midpoints of 15 mHz resolve notches of some hertz and miss narrower ones by their width
        assert found.noise_gain == pytest.approx(math.sqrt(np.mean(power)), rel=2e-3)
        y = rng.normal(size=n)
        time, velocity = np.arange(n) * PERIOD, np.full(n, 156.0)
        out = OnlineFilter(model).process(time, velocity, y).torque_filtered_nm[n // 2 :]
        # standard error of a standard deviation of 30 000 samples, four times
        assert np.std(out) == pytest.approx(found.noise_gain, rel=4.0 / math.sqrt(n))


def test_the_steady_covariance_solves_the_riccati_equation(bench):
    for model in models(bench):
        steady = steady_filter(model, 100.0, PERIOD)
        p = steady.covariance
        assert (np.linalg.eigvalsh(p) > -1e-12).all()
        assert np.array_equal(p, p.T)
    model = preset("report-6", bench)
    turns = [b.order * 100.0 * PERIOD for b in model.blocks]
    c = np.array([[1.0, 0.0] * 3])
    phi = block_diag(*([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]] for a in turns))
    q = np.diag(np.repeat([b.process_noise for b in model.blocks], 2))
    wanted = solve_discrete_are(phi.T, c.T, q, np.eye(1))
    # two solvers; the equation's own conditioning
    assert_allclose(steady_filter(model, 100.0, PERIOD).covariance, wanted, rtol=1e-6)


@pytest.mark.parametrize("velocity", [0.0, math.nan, math.inf])
def test_there_is_no_response_at_standstill(bench, velocity):
    with pytest.raises(DataError, match="steady gain"):
        filter_response(preset("report-6", bench), velocity, PERIOD)
