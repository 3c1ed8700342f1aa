"""A filter model as the state-space model that the kernel runs."""

from __future__ import annotations

import math

from hdbench.filter.blocks import OscillatorBlock, SlowBlock
from hdbench.filter.model import FilterModel
from hdbench.filter.statespace import StateBlock, StateSpace

__all__ = ["state_space"]


def state_space(model: FilterModel) -> StateSpace:
    """Return the state-space model of a filter model.

    Parameters
    ----------
    model : FilterModel
        Blocks, noise and start.

    Returns
    -------
    StateSpace
        Oscillators first, then slow torque, in the model's order.
    """
    order_prior = _variance(model.order_prior_std_nm)
    slow_prior = _variance(model.slow_prior_std_nm)
    return StateSpace(
        blocks=(
            *(_oscillator(block, order_prior) for block in model.blocks),
            *(_slow(block, slow_prior) for block in model.slow),
        ),
        measurement_noise=model.measurement_noise,
        load_inertia_kg_m2=model.load_inertia_kg_m2,
        gear_ratio=model.gear_ratio,
        differentiator_time_constant_s=model.differentiator_time_constant_s,
        start="listing" if model.order_prior_std_nm is None else "prior",
        gate_sigma=model.gate_sigma,
    )


def _variance(std: float | None) -> float:
    return 1.0 if std is None else std * std


def _oscillator(block: OscillatorBlock, prior: float) -> StateBlock:
    noise = {"sample": 0.0, "motor-radian": 0.0, "second": 0.0}
    noise[block.noise_per] = block.process_noise
    return StateBlock(
        kind="oscillator",
        part=block.role,
        order=block.order,
        frequency_hz=block.frequency_hz,
        noise_per_sample=noise["sample"],
        noise_per_rad=noise["motor-radian"],
        noise_per_s=noise["second"],
        prior_variance=prior,
        prior_variance_2=prior,
    )


def _slow(block: SlowBlock, prior: float) -> StateBlock:
    first, second = prior, prior
    if block.stationary:
        # the stationary covariance of torque and slope: var and var times the squared rate
        rate = 2.0 * math.pi * block.frequency_hz or 1.0 / block.time_constant_s
        first, second = block.variance, block.variance * rate * rate
    return StateBlock(
        kind=block.kind,
        part="slow",
        frequency_hz=block.frequency_hz,
        noise_per_s=block.noise_per_s,
        variance=block.variance,
        time_constant_s=block.time_constant_s,
        prior_variance=first,
        prior_variance_2=second,
    )
