"""The recursion against equations 5-10."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from filter_oracle import Bench, expected_torque, literal, motion
from kernel_models import filter_model
from numpy.testing import assert_allclose

from hdbench.filter import OnlineFilter, OscillatorBlock, load_filter_model, preset

# the contract's orders and noise of the three presets, typed again here
REPORT = {
    "report-a1": ([2, 4], [1000, 1000], ["r", "r"]),
    "report-a2": ([2, 0.01], [1000, 0.05], ["r", "m"]),
    "report-6": ([2, 4, 0.01], [1000, 1000, 0.05], ["r", "r", "m"]),
}


def free_model(orders, noise, *, r=0.01, inertia=0.0, angle=False):
    blocks = tuple(OscillatorBlock(o, "ripple", q) for o, q in zip(orders, noise, strict=True))
    return filter_model(blocks, r, inertia=inertia, angle=angle)


@cache
def by_equations(name):
    """Return time, velocity, torque, and the parts of the report's blocks in it."""
    t, v, y, _ = motion(2000)
    return t, v, y, literal(t, v, y, *REPORT[name][:2])


@pytest.mark.parametrize("name", REPORT)
def test_presets_agree_with_the_literal_equations(bench, kernel, name):
    t, v, y, parts = by_equations(name)
    roles = np.array(REPORT[name][2])
    block = OnlineFilter(load_filter_model(name, bench), kernel=kernel).process(t, v, y)
    # the acceptance's 1e-9 N m; rounding alone is some 1e-12 after the standstill
    close = {"rtol": 0.0, "atol": 1e-9}
    assert_allclose(block.torque_filtered_nm, y - parts.sum(axis=1), **close)
    assert_allclose(block.torque_expected_nm, expected_torque(t, v), **close)
    assert_allclose(block.ripple_nm, parts[:, roles == "r"].sum(axis=1), **close)
    assert_allclose(block.misalignment_nm, parts[:, roles == "m"].sum(axis=1), **close)


@pytest.fixture(scope="module")
def standing():
    """Return time, velocity, torque of a long standstill, and what the equations leave of it."""
    t = np.arange(8000) * 1e-3
    v = np.where(t < 7.0, 0.0, 120.0 * np.sin(9.0 * (t - 7.0)))
    y = 3.0 + np.random.default_rng(5).normal(0.0, 0.1, t.size)
    return t, v, y, y - literal(t, v, y, *REPORT["report-6"][:2]).sum(axis=1)


def test_presets_agree_after_a_long_standstill(bench, kernel, standing):
    t, v, y, wanted = standing
    block = OnlineFilter(preset("report-6", bench), kernel=kernel).process(t, v, y)
    # P grows by Q per sample along what standstill hides, to 7e6: its rounding is 1e-9 of S ~ 1e3
    assert_allclose(block.torque_filtered_nm, wanted, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("n_blocks", [1, 2, 3, 4, 5, 16])
def test_any_number_of_blocks_agrees_with_the_literal_equations(kernel, n_blocks):
    t, v, y, _ = motion(400)
    orders = [0.5 + 0.73 * i for i in range(n_blocks)]
    noise = [1e-4 * (1 + i) for i in range(n_blocks)]
    parts = literal(t, v, y, orders, noise, Bench(inertia=0.0, r=0.01))
    block = OnlineFilter(free_model(orders, noise), kernel=kernel).process(t, v, y)
    # covariances stay of order 1: a few thousand roundings of 1e-16
    assert_allclose(block.ripple_nm, parts.sum(axis=1), rtol=0.0, atol=1e-11)


def test_a_measured_angle_turns_the_blocks_where_the_model_asks_for_it(kernel):
    t, v, y, angle = motion(800)
    slipped = angle * 1.01
    noise = ([2.0, 4.0], [1e-3, 1e-3])
    for asked, used in ((True, slipped), (False, None)):
        online = OnlineFilter(free_model(*noise, angle=asked), kernel=kernel)
        found = online.process(t, v, y, slipped).ripple_nm
        wanted = literal(t, v, y, *noise, Bench(inertia=0.0, r=0.01), angle=used).sum(axis=1)
        # rounding of the angle (100 rad) and of some hundred steps
        assert_allclose(found, wanted, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("orders", "turn_rad"),
    [
        *(([1.0], turn) for turn in (0.3, 1.7, 3.2, 1e3, 99_999.0, 3e5, 1e9)),
        # an order twice another turns through the other's angle, doubled
        *product([[1.0, 2.0, 4.0], [4.0, 1.0, 2.0], [2.0, 3.0, 4.0]], [0.3, 40.0, 3e5]),
    ],
)
def test_turns_of_any_size_keep_their_phase(kernel, orders, turn_rad):
    rng = np.random.default_rng(2)
    t = np.arange(60.0)
    v = turn_rad * rng.uniform(-1.0, 1.0, t.size)
    y = rng.normal(0.0, 1.0, t.size)
    noise = [0.1, 0.2, 0.05][: len(orders)]
    block = OnlineFilter(free_model(orders, noise), kernel=kernel).process(t, v, y)
    wanted = literal(t, v, y, orders, noise, Bench(inertia=0.0, r=0.01)).sum(axis=1)
    # order * v * dt is the same double on both sides, so only the sines' own rounding differs:
    # 4e-15 rad a sample at most, doubled twice
    assert_allclose(block.ripple_nm, wanted, rtol=0.0, atol=1e-12 if len(orders) == 1 else 1e-11)
