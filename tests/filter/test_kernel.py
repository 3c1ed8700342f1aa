"""The compiled kernel: beside the NumPy form, its checks of arrays, and how a form is chosen."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest
from kernel_models import (
    KINDS,
    batch,
    filter_model,
    listing,
    new_state,
    order_block,
    run,
    samples,
    slow_block,
    smooth,
    tuned,
)
from numpy.testing import assert_allclose, assert_array_equal

from hdbench.errors import DataError, UsageError
from hdbench.filter import FilteredBlock, kalman, kernel_name, kernel_reason
from hdbench.filter.kalman import GATED, MISSING, UNRESOLVED, pack

_kernel = pytest.importorskip("hdbench.filter._kernel", reason="the C kernel was not compiled here")
PRIOR = {"order_prior_std_nm": 1.0, "slow_prior_std_nm": 1.0}
MODELS = {
    "listing": listing(),
    "one order": listing(((2.0, 0.1),)),
    "two orders": listing(((2.0, 1000.0), (4.0, 1000.0))),
    **{kind: tuned(kind, gate=6.0) for kind in KINDS},
    "three and two": filter_model(
        (order_block(2.0), order_block(0.01), order_block(4.0)),
        0.01,
        slow=(slow_block("matern-3/2"), slow_block("random-walk")),
        gate_sigma=5.0,
        **PRIOR,
    ),
    "sixteen": filter_model((order_block(0.5 + i) for i in range(16)), 0.01, **PRIOR),
}
NUMBERS = [item.name for item in fields(FilteredBlock) if item.name.endswith(("_nm", "_nm2"))]


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]


def alike(one, two):
    """1e-9 N m is the promise; a variance is the square of some N m."""
    for name in NUMBERS:
        values = getattr(two, name)
        scale = max(1.0, np.nanmax(np.abs(values))) if name.endswith("nm2") else 1.0
        assert_allclose(getattr(one, name), values, rtol=0.0, atol=1e-9 * scale, err_msg=name)
    assert_array_equal(one.flags, two.flags)
    assert one.n_used == two.n_used
    # sums of some hundred terms
    assert one.log_likelihood == pytest.approx(two.log_likelihood, rel=1e-8)


def test_both_forms_agree(model):
    t, v, y = samples(400)
    alike(*(run(model, new_state(model), t, v, y, form=form) for form in ("c", "numpy")))


def test_both_forms_go_on_from_the_state_of_the_other():
    model = tuned(gate=6.0)
    t, v, y = samples(300)
    whole = run(model, new_state(model), t, v, y).torque_filtered_nm[200:]
    for first, second in (("c", "numpy"), ("numpy", "c")):
        state = new_state(model)
        run(model, state, t[:200], v[:200], y[:200], form=first)
        rest = run(model, state, t[200:], v[200:], y[200:], form=second)
        assert_allclose(rest.torque_filtered_nm, whole, rtol=0.0, atol=1e-9)


def test_both_forms_agree_with_a_measured_angle():
    t, v, y = samples(400, missing=False)
    angle = np.cumsum(v) * 1e-3
    angle[100:140] = np.nan
    one, two = (
        run(tuned(), new_state(tuned()), t, v, y, angle_rad=angle, form=form)
        for form in ("c", "numpy")
    )
    alike(one, two)
    without = run(tuned(), new_state(tuned()), t, v, y)
    assert not np.array_equal(one.torque_filtered_nm, without.torque_filtered_nm)


@pytest.mark.parametrize("n_traces", [1, 3, 8, 11])
def test_a_batch_gives_every_trace_the_bits_it_has_alone(model, n_traces):
    t, v, y = samples(200)
    velocity = np.stack([v * (1.0 + 0.01 * i) for i in range(n_traces)], axis=1)
    torque = np.stack([np.roll(y, 37 * i) for i in range(n_traces)], axis=1)
    torque[:5, -1] = np.nan  # this lane starts later than the others
    found = batch(model, t, velocity, torque, innovations=True)
    for i in range(n_traces):
        alone = run(model, new_state(model), t, velocity[:, i], torque[:, i])
        for name in ("torque_filtered_nm", "innovation_nm", "innovation_variance_nm2"):
            assert_array_equal(getattr(found, name)[:, i], getattr(alone, name))
        assert found.sum_log_variance[i] == alone.sum_log_variance
        assert found.sum_normalised_squares[i] == alone.sum_normalised_squares


def test_both_forms_of_the_batch_agree():
    t, v, y = samples(120)
    columns = np.stack([v, -v], axis=1), np.stack([y, y], axis=1)
    one, two = (batch(tuned(), t, *columns, innovations=True, form=f) for f in ("c", "numpy"))
    assert_allclose(one.torque_filtered_nm, two.torque_filtered_nm, rtol=0.0, atol=1e-9)
    assert_allclose(one.innovation_nm, two.innovation_nm, rtol=0.0, atol=1e-9)
    assert_array_equal(one.n_used, two.n_used)


def test_both_forms_smooth_alike(model):
    t, v, y = samples(600)  # more than one of the kernel's segments
    one, two = (smooth(model, t, v, y, form=form) for form in ("c", "numpy"))
    scale = np.nanmax(np.abs(two.mean))
    # the two sum in another order: rounding times the condition of orders that lie side by side
    assert_allclose(one.mean, two.mean, rtol=0.0, atol=1e-8 * scale)
    assert_allclose(one.covariance, two.covariance, rtol=1e-6, atol=1e-6 * scale**2)
    assert_allclose(one.torque_expected_nm, two.torque_expected_nm, rtol=0.0, atol=1e-9)


def test_a_missing_a_gated_and_an_unresolved_sample_are_flagged():
    t, v, y = samples(600)
    flags = run(tuned(gate=6.0), new_state(tuned()), t, v, y).flags
    missing = ~(np.abs(y) < 1e12) | np.isnan(v)
    assert_array_equal((flags & MISSING) > 0, missing)
    assert flags[400] & GATED  # the outlier
    still = np.zeros(600)
    report = run(listing(), new_state(listing()), t, still, y).flags
    assert (report[590:] & UNRESOLVED).all()  # at standstill every block is a constant
    turning = np.full(600, 100.0)
    assert not (run(listing(), new_state(listing()), t, turning, y).flags[300:] & UNRESOLVED).any()


@pytest.mark.parametrize("form", ["c", "numpy"])
def test_the_gate_lets_a_step_through_after_five_samples(form):
    slow = (slow_block("random-walk"),)
    model = filter_model((order_block(2.0),), 0.01, slow=slow, gate_sigma=5.0, **PRIOR)
    y = np.where(np.arange(200) < 100, 0.0, 50.0)
    t = np.arange(200) * 1e-3
    flags = run(model, new_state(model), t, np.zeros(200), y, form=form).flags
    assert np.flatnonzero(flags & GATED)[:5].tolist() == [100, 101, 102, 103, 104]
    assert not flags[105] & GATED


def test_a_held_estimate_stays_through_a_standstill_without_torque():
    model = tuned()
    t = np.arange(4000) * 1e-3
    v = np.where(t < 1.0, 100.0, 0.0)
    y = 0.4 * np.cos(2.0 * np.minimum(t, 1.0) * 100.0)
    y[1001:] = np.nan
    found = run(model, new_state(model), t, v, y)
    part = found.ripple_nm + found.misalignment_nm
    # the 50 Hz block turns with the clock; at whole periods only its rotation's rounding is left
    assert part[3999 - 20] == pytest.approx(part[1199], abs=1e-9)


@pytest.mark.parametrize("form", ["c", "numpy"])
def test_the_first_sample_with_a_wrong_time_is_named(form):
    t = np.arange(20.0)
    t[13] = t[12]
    state = new_state(listing())
    with pytest.raises(DataError, match=r"12\.0.* s; needed"):
        run(listing(), state, t, np.zeros(20), np.zeros(20), form=form)
    assert not state.any()
    with pytest.raises(DataError, match="later than"):
        smooth(listing(), t, np.zeros(20), np.zeros(20), form=form)
    with pytest.raises(DataError, match="later than"):
        batch(listing(), t, np.zeros((20, 2)), np.zeros((20, 2)), form=form)


def arguments(n=20):
    return {
        "model": pack(listing()),
        "state": new_state(listing()),
        "samples": (np.arange(n) * 1e-3, np.full(n, 20.0), np.zeros(n), None),
        "outputs": tuple(np.empty(n) for _ in range(7)),
        "flags": np.empty(n, np.uint8),
        "sums": np.empty(3),
    }


def replaced(values, i, value):
    return tuple(value if k == i else v for k, v in enumerate(values))


def read_only(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("model", lambda a: a[:-1]),
        ("model", lambda a: a[:5]),
        ("model", lambda a: a.astype(np.float32)),
        ("state", lambda a: a[:-1]),
        ("state", read_only),
        ("samples", lambda a: replaced(a, 0, np.arange(20))),
        ("samples", lambda a: replaced(a, 0, np.arange(20.0).astype(">f8"))),
        ("samples", lambda a: replaced(a, 1, np.zeros(40)[::2])),
        ("samples", lambda a: replaced(a, 1, np.zeros(19))),
        ("samples", lambda a: replaced(a, 2, [0.0] * 20)),
        ("samples", lambda a: replaced(a, 2, np.zeros(161, np.uint8)[1:].view(np.float64))),
        ("samples", lambda a: replaced(a, 3, np.zeros(19))),
        ("samples", lambda a: a[:3]),
        ("outputs", lambda a: replaced(a, 4, np.empty(5))),
        ("outputs", lambda a: replaced(a, 4, a[1])),
        ("outputs", lambda a: replaced(a, 4, None)),
        ("outputs", list),
        ("flags", lambda a: a[1:]),
        ("flags", lambda a: a.astype(float)),
        ("sums", lambda a: np.empty(2)),
    ],
)
def test_the_kernel_refuses_arrays_that_do_not_fit(name, change):
    given = arguments()
    given[name] = change(given[name])
    with pytest.raises((ValueError, TypeError, BufferError)):
        _kernel.run(*given.values())


@pytest.mark.parametrize(
    ("index", "value"),
    [
        *((0, 17.0), (0, math.nan), (1, 1.0), (2, 0.0), (3, -1.0), (4, math.nan), (5, 0.0)),
        *((6, -1.0), (7, 0.0), (9, 1.0), (10, 2.0), (11, 0.0), (13, -1.0), (14, math.inf)),
        (18, math.nan),
    ],
)
def test_the_kernel_refuses_numbers_out_of_their_domain(index, value):
    given = arguments()
    given["model"][index] = value
    with pytest.raises(ValueError, match="out of its domain"):
        _kernel.run(*given.values())
    assert not given["state"].any()


def test_a_state_of_another_model_is_refused():
    t, v, y = samples(10)
    with pytest.raises(ValueError, match="state has shape"):
        run(listing(), new_state(listing(((2.0, 0.1),))), t, v, y)


def test_threads_on_states_of_their_own_do_not_disturb_each_other():
    t, v, y = samples(20_000)
    models = [MODELS[name] for name in ("listing", "matern-3/2", "three and two", "sixteen")]

    def work(model):
        return run(model, new_state(model), t, v, y)

    with ThreadPoolExecutor(len(models)) as pool:
        found = list(pool.map(work, models))
    for i, wanted in enumerate(map(work, models)):
        for field in fields(FilteredBlock):
            assert_array_equal(getattr(found[i], field.name), getattr(wanted, field.name))


def test_the_covariance_neither_drifts_nor_loses_its_sign():
    model = tuned()
    n = 50_000
    t = np.arange(n) * 1e-3
    v = 100.0 * np.sin(2.0 * np.pi * 0.5 * t)
    y = np.zeros(n)
    state = new_state(model)
    found = []
    for k in range(12):
        run(model, state, t + k * n * 1e-3, v, y)
        found.append(covariance_of(state, 4))
        # symmetric by its storage; a triangle of a positive matrix
        assert np.linalg.eigvalsh(found[-1]).min() > -1e-15
    # the motion repeats every 2 s, so once settled does P
    assert_allclose(found[-1], found[-2], rtol=1e-6, atol=1e-9)


def covariance_of(state, n_blocks):
    size = 2 * n_blocks
    p = np.zeros((size, size))
    p[np.tril_indices(size)] = state[-size * (size + 1) // 2 :]
    return p + np.tril(p, -1).T


def test_the_environment_chooses_the_form(monkeypatch):
    monkeypatch.delenv("HDBENCH_KERNEL", raising=False)
    assert (kernel_name(), "compiled" in kernel_reason()) == ("c", True)
    monkeypatch.setenv("HDBENCH_KERNEL", "numpy")
    assert (kernel_name(), "HDBENCH_KERNEL" in kernel_reason()) == ("numpy", True)
    monkeypatch.setenv("HDBENCH_KERNEL", "fortran")
    with pytest.raises(UsageError, match="fortran"):
        kernel_name()


def test_without_a_compiled_kernel_the_python_form_runs_and_says_why(monkeypatch):
    monkeypatch.delenv("HDBENCH_KERNEL", raising=False)
    monkeypatch.setattr(kalman, "_compiled", lambda: (None, "the C kernel was not compiled"))
    assert kernel_name() == "numpy"
    assert "not compiled" in kernel_reason()
    with pytest.raises(ValueError, match="not compiled"):
        kalman.kernel_form("c")
    with pytest.raises(ValueError, match="fortran"):
        kalman.kernel_form("fortran")
    monkeypatch.setenv("HDBENCH_KERNEL", "c")
    with pytest.raises(UsageError, match="not compiled"):
        kernel_name()
