"""Diagnosis: its result, with the extended model and the data for pictures beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, InstanceOf

from hdbench.model import BenchModel
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import (
    DiagnosisResult,
    LeftOutSamples,
    ModelFit,
    NamedCause,
    StretchFlag,
    Unexplained,
)

_Found = TypeVar("_Found", NamedCause, Unexplained)


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitudes of lines along one axis, without and with the causes; arrays of shape (m,)."""

    domain: str  # ``motor-order``, ``output-order`` or ``frequency``
    unit: str
    axis: FloatArray
    before_nm: FloatArray  # largest amplitude in the cell of each point
    after_nm: FloatArray


@dataclass(frozen=True, slots=True)
class Pictures:
    """Everything that a picture of the diagnosis needs; arrays of shape (n_samples,)."""

    time_s: FloatArray
    velocity_rad_s: FloatArray
    measured_nm: FloatArray  # NaN where lost
    simulated_nm: FloatArray  # by the model as it was handed in
    extended_nm: FloatArray  # as the torque channel passes it
    residual_before_nm: FloatArray  # measured less fitted baseline; NaN where not used
    residual_after_nm: FloatArray  # less baseline and causes
    masked: NDArray[np.bool_]  # samples that no fit used
    spectra: tuple[Spectrum, ...]
    acceleration_rad_s2: FloatArray
    motor_angle_rad: FloatArray
    output_angle_rad: FloatArray
    applied_nm: FloatArray  # the known torque through the flexspline


class Diagnosis(DiagnosisResult):
    """Result of a diagnosis, and what stays in memory beside it.

    Parameters
    ----------
    model : BenchModel
        The extended model.
    pictures : Pictures or None
        Data for pictures of a dynamic run; None where no baseline could be fitted.
    load_pictures : mapping of str to ndarray, shape (n_readings,), or None
        Data for pictures of calibration loads, columns of ``residual.csv``; None for a dynamic run,
        and as above.
    """

    model: InstanceOf[BenchModel] = Field(exclude=True)
    pictures: InstanceOf[Pictures] | None = Field(default=None, exclude=True)
    load_pictures: Mapping[str, Any] | None = Field(default=None, exclude=True)


def data_bad(
    model: BenchModel,
    terms: Sequence[str],
    flags: tuple[StretchFlag, ...],
    settings: Mapping[str, Any],
    reason: str,
    left_out: tuple[LeftOutSamples, ...] = (),
) -> Diagnosis:
    """Return the answer for a record of which nothing can be said."""
    nothing = ModelFit(terms=tuple(terms), heldout_rms_nm=None)
    return Diagnosis(
        verdict="data-bad",
        reason=reason,
        data_flags=flags,
        left_out=left_out,
        simulated=nothing,
        extended=nothing,
        settings=dict(settings),
        model=model,
    )


def by_share(found: Sequence[_Found], least: float) -> tuple[tuple[_Found, ...], ...]:
    """Return what explains a share of the variance or more, and what explains less."""
    kept = tuple(one for one in found if one.share_of_variance >= least)
    return kept, tuple(one for one in found if one not in kept)


def verdict_of(causes: Sequence[NamedCause], places: Sequence[Unexplained]) -> str:
    """Return the verdict of the contract on what was found."""
    if causes and places:
        return "named-and-unexplained"
    if causes:
        return "named"
    return "unexplained" if places else "nothing-found"
