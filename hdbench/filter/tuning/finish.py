"""A tuned model in absolute units, with its stated priors and where its numbers came from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hdbench.filter.channels import Channels
from hdbench.filter.model import FilterModel
from hdbench.filter.tuning.settings import TuningSettings

__all__ = ["finished", "scaled"]


def scaled(relative: FilterModel, noise_nm2: float) -> FilterModel:
    """Return a model of measurement noise 1 in absolute units."""
    scale = math.sqrt(noise_nm2)
    prior, slow_prior = relative.order_prior_std_nm, relative.slow_prior_std_nm
    return replace(
        relative,
        blocks=tuple(
            replace(block, process_noise=block.process_noise * noise_nm2)
            for block in relative.blocks
        ),
        slow=tuple(
            replace(
                block,
                noise_per_s=block.noise_per_s * noise_nm2,
                variance=block.variance * noise_nm2,
            )
            for block in relative.slow
        ),
        measurement_noise=noise_nm2,
        order_prior_std_nm=None if prior is None else prior * scale,
        slow_prior_std_nm=None if slow_prior is None else slow_prior * scale,
    )


def finished(
    model: FilterModel,
    base: FilterModel,
    settings: TuningSettings,
    records: Sequence[Channels],
    origins: Mapping[str, str],
) -> FilterModel:
    """Return the model with its stated priors, gate and provenance."""
    names = ", ".join(record.source for record in records)
    span = float(np.sum([record.time_s[-1] - record.time_s[0] for record in records]))
    return replace(
        model,
        name="tuned",
        order_prior_std_nm=settings.order_prior_std_nm,
        slow_prior_std_nm=settings.slow_prior_std_nm,
        gate_sigma=settings.gate_sigma,
        provenance={
            **{k: v for k, v in base.provenance.items() if k != "noise"},
            "noise": f"maximum likelihood on {names} ({span:.6g} s)",
            "slow torque": f"kind asked for: {settings.slow}; chosen by penalised likelihood",
            "prior": "stated before the data: order_prior_std_nm and slow_prior_std_nm",
            **origins,
        },
    )
