"""The compiled kernel's own guards, and how a form is chosen."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from hdbench.errors import UsageError
from hdbench.filter import core, kernel_name, kernel_reason, recursion
from hdbench.filter.layout import state_size

_kernel = pytest.importorskip("hdbench.filter._kernel", reason="the C kernel was not compiled here")
NAMES = ("order", "noise", "role", "parameters", "state", "time", "velocity", "torque", "angle")
OUTPUTS = ("expected", "ripple", "misaligned", "filtered")


def arguments(n=20, n_blocks=2):
    rng = np.random.default_rng(0)
    return {
        "order": np.arange(1.0, n_blocks + 1.0),
        "noise": np.full(n_blocks, 0.1),
        "role": np.zeros(n_blocks),
        "parameters": np.array([1.0, 0.0, 100.0, 0.005]),
        "state": np.zeros(state_size(n_blocks)),
        "time": np.arange(n) * 1e-3,
        "velocity": np.full(n, 20.0),
        "torque": rng.normal(size=n),
        "angle": None,
        **{name: np.empty(n) for name in OUTPUTS},
    }


def call(given, run=None):
    return (run or _kernel.run)(*(given[name] for name in NAMES + OUTPUTS))


def read_only(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time", np.arange(20)),
        ("time", np.arange(20, dtype=np.float32)),
        ("time", np.arange(20.0).astype(">f8")),
        ("time", np.zeros((4, 5))),
        ("velocity", np.zeros(40)[::2]),
        ("velocity", np.zeros(19)),
        ("torque", np.zeros(21)),
        ("torque", [0.0] * 20),
        ("torque", np.frombuffer(bytes(161), dtype=np.uint8)[1:].view(np.float64)),
        ("angle", np.zeros(19)),
        ("state", np.zeros(3)),
        ("state", read_only(np.zeros(state_size(2)))),
        ("parameters", np.zeros(5)),
        ("noise", np.ones(3)),
        ("role", np.zeros(1)),
        ("order", np.zeros(0)),
        ("order", np.arange(1.0, 18.0)),
        ("ripple", np.empty(5)),
        ("filtered", read_only(np.empty(20))),
    ],
)
def test_the_kernel_refuses_buffers_that_do_not_fit(name, value):
    with pytest.raises((ValueError, TypeError, BufferError)):
        call({**arguments(), name: value})


def test_the_kernel_refuses_arguments_in_the_wrong_number():
    with pytest.raises(TypeError):
        _kernel.run(np.zeros(1))


@pytest.mark.parametrize("other", ["torque", "ripple", "order", "state"])
def test_the_kernel_refuses_outputs_that_share_memory(other):
    given = arguments()
    shared = np.zeros(100)
    given["filtered"] = shared[:20]
    given[other] = shared[10 : 10 + given[other].size]
    with pytest.raises(ValueError, match="share memory"):
        call(given)


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [
        ("order", 0, 0.0),
        ("order", 1, np.nan),
        ("noise", 0, -1.0),
        ("noise", 1, np.inf),
        ("role", 0, 0.5),
        ("parameters", 0, 0.0),
        ("parameters", 1, -1.0),
        ("parameters", 2, np.nan),
        ("parameters", 3, 0.0),
    ],
)
def test_the_kernel_refuses_parameters_out_of_their_domain(name, index, value):
    given = arguments()
    given[name][index] = value
    with pytest.raises(ValueError, match="positive and finite"):
        call(given)
    assert not given["state"].any()


@pytest.mark.parametrize("run", [_kernel.run, recursion.run], ids=["c", "numpy"])
def test_both_forms_name_the_first_sample_with_a_wrong_time(run):
    given = arguments()
    given["time"][13] = given["time"][12]
    assert call(given, run) == 13
    assert not given["state"].any()


def test_threads_on_states_of_their_own_do_not_disturb_each_other():
    jobs = [arguments(20_000, n_blocks) for n_blocks in (2, 3, 2, 5)]
    alone = [arguments(20_000, n_blocks) for n_blocks in (2, 3, 2, 5)]
    for job in alone:
        call(job)
    threads = [threading.Thread(target=call, args=(job,)) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, other in zip(jobs, alone, strict=True):
        assert_array_equal(one["filtered"], other["filtered"])


def test_the_environment_chooses_the_form(monkeypatch):
    monkeypatch.delenv("HDBENCH_KERNEL", raising=False)
    assert (kernel_name(), "compiled" in kernel_reason()) == ("c", True)
    monkeypatch.setenv("HDBENCH_KERNEL", "numpy")
    assert (kernel_name(), "HDBENCH_KERNEL" in kernel_reason()) == ("numpy", True)
    monkeypatch.setenv("HDBENCH_KERNEL", "fortran")
    with pytest.raises(UsageError, match="fortran"):
        kernel_name()


def test_without_a_compiled_kernel_the_numpy_form_runs_and_says_why(monkeypatch):
    monkeypatch.delenv("HDBENCH_KERNEL", raising=False)
    monkeypatch.setattr(core, "_compiled", lambda: (None, "the C kernel was not compiled"))
    assert kernel_name() == "numpy"
    assert "not compiled" in kernel_reason()
    assert core.run_form("numpy") is recursion.run
    with pytest.raises(ValueError, match="not compiled"):
        core.run_form("c")
    monkeypatch.setenv("HDBENCH_KERNEL", "c")
    with pytest.raises(UsageError, match="not compiled"):
        kernel_name()
