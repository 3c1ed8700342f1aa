"""Filter models and samples for the kernel's tests, and the kernel called with a model."""

import numpy as np
from filter_oracle import motion

from hdbench.filter import FilterModel, OscillatorBlock, SlowBlock, kalman

KINDS = ("random-walk", "integrated-random-walk", "ornstein-uhlenbeck", "matern-3/2", "resonance")
SLOW = {
    "random-walk": {"noise_per_s": 0.3},
    "integrated-random-walk": {"noise_per_s": 5.0},
    "ornstein-uhlenbeck": {"variance": 2.0, "time_constant_s": 0.05},
    "matern-3/2": {"variance": 2.0, "time_constant_s": 0.05},
    "resonance": {"variance": 2.0, "time_constant_s": 0.1, "frequency_hz": 3.0},
}


def new_state(model):
    return kalman.new_state(kalman.pack(model))


def run(model, state, *samples, angle_rad=None, **options):
    return kalman.run(kalman.pack(model), state, (*samples, angle_rad), **options)


def batch(model, *samples, **options):
    return kalman.batch(kalman.pack(model), (*samples, None), **options)


def smooth(model, *samples, **options):
    return kalman.smooth(kalman.pack(model), (*samples, None), **options)


def filter_model(blocks, r, *, inertia=0.0, angle=False, **more):
    return FilterModel("own", tuple(blocks), r, inertia, 100.0, 0.005, angle, **more)


def listing(orders=((2.0, 1000.0), (4.0, 1000.0), (0.01, 0.05)), r=1.0):
    blocks = [OscillatorBlock(o, "ripple" if o >= 1 else "misalignment", q) for o, q in orders]
    return filter_model(blocks, r, inertia=1.725e-2)


def slow_block(kind):
    return SlowBlock(kind, **SLOW[kind])


def order_block(order, q=1e-4, part="ripple"):
    return OscillatorBlock(order, part, q, "motor-radian")


THREE_ORDERS = (
    order_block(2.0, 1e-9),
    order_block(4.0, 1e-9),
    order_block(0.01, 1e-9, "misalignment"),
)


def tuned(kind="matern-3/2", *, gate=None, r=2.5e-3, inertia=1.725e-2):
    blocks = (
        order_block(2.0),
        OscillatorBlock(0.0, "ripple", 1e-3, "second", 50.0),
        order_block(0.01, 1e-3, "misalignment"),
    )
    prior = {"order_prior_std_nm": 0.5, "slow_prior_std_nm": 3.0, "gate_sigma": gate}
    return filter_model(blocks, r, inertia=inertia, slow=(slow_block(kind),), **prior)


def samples(n=1500, seed=1, missing=True):
    """Return time, velocity, torque of the oracle's motion, with gaps and an outlier."""
    t, v, y, _ = motion(n, seed)
    if missing:
        y[n // 2 : n // 2 + 20] = np.nan
        v[n // 2 + 10 : n // 2 + 30] = np.nan
        y[2 * n // 3] += 30.0
        y[3 * n // 4] = np.inf
    return t, v, y
