"""Filter model from stored results of the three experiments."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from hdbench.errors import DataError
from hdbench.filter.model import FilterModel, OscillatorBlock, first_problem

_PREFIX = "results-on-"


def value_of(entry: object) -> object:
    """Return the value of an object with an uncertainty, or a number itself."""
    return entry.get("value") if isinstance(entry, Mapping) else entry


_Number = Annotated[float, BeforeValidator(value_of)]
_Positive = Annotated[_Number, Field(gt=0.0)]


class Stored(BaseModel):
    """The keys of a stored result or model that a filter takes; others are left alone."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Noise(Stored):
    measurement_noise: _Positive | None = None
    process_noise: _Positive | None = None


class _Order(Stored):
    order: _Positive


class _Ripple(Stored):
    ripple: Annotated[list[_Order], Field(min_length=1)]
    filter: _Noise = _Noise()


class _Block(_Order, _Noise):
    """The block that a misalignment adds."""


class _Misalignment(Stored):
    filter: _Block


class _Calibration(Stored):
    gain_nm_per_v: _Number


_Kind = TypeVar("_Kind", bound=Stored)


def _read(kind: type[_Kind], result: Mapping[str, Any], what: str) -> _Kind:
    """Return what a filter takes of a result."""
    try:
        return kind.model_validate(result)
    except ValidationError as error:
        place, found = first_problem(error)
        raise _bad(found, f"{what} result:{place}") from error


def build_filter_model(
    base: FilterModel,
    *,
    ripple: Mapping[str, Any] | None = None,
    misalignment: Mapping[str, Any] | None = None,
    calibration: Mapping[str, Any] | None = None,
) -> FilterModel:
    """Return a filter model with the numbers of stored results.

    Parameters
    ----------
    base : FilterModel
        Serves for every number that no result gives.
    ripple : mapping or None
        Result of a ripple run: the orders of ``ripple`` replace the ripple blocks; ``filter`` may
        give ``measurement_noise`` (R) and ``process_noise`` (Q of these blocks), (N m)^2.
    misalignment : mapping or None
        Result of a misalignment run: ``filter`` is the output-order block (``order`` and, else as
        in `base`, ``process_noise`` at ``measurement_noise``); it replaces the block of that
        order or joins the others.
    calibration : mapping or None
        Result of a calibration: ``gain_nm_per_v`` becomes the gain for traces in volts.

    Returns
    -------
    FilterModel
        `base` itself where no result is given; else turning with a measured angle where there is
        one. Its provenance names for each number the
        result, its run where it says so, and the SHA-256 of the result.

    Raises
    ------
    DataError
        If a result lacks what it should give, or gives a number out of its domain.

    Notes
    -----
    A new R scales every Q that no result gives by the same factor: the filter's gain depends on
    Q/R alone, so those blocks stay as selective as in `base`. A tuned base keeps all its noise:
    results give it orders only, with the noise of its own block of that kind.
    """
    if ripple is None and misalignment is None and calibration is None:
        return base
    blocks, tuned = base.blocks, base.order_prior_std_nm is not None
    provenance = dict(base.provenance)
    r, gain = base.measurement_noise, base.torque_gain_nm_per_v
    if misalignment is not None:
        block = _read(_Misalignment, misalignment, "misalignment").filter
        added = _with_misalignment(blocks, block, r)
        blocks = _own_noise(blocks, added) if tuned else added
        provenance["misalignment block"] = _origin(misalignment, "misalignment")
    if ripple is not None:
        added, new_r = _with_ripple(blocks, _read(_Ripple, ripple, "ripple"), r)
        blocks, r = (_own_noise(blocks, added), r) if tuned else (added, new_r)
        provenance["ripple blocks, measurement_noise"] = _origin(ripple, "ripple")
    if calibration is not None:
        gain = _read(_Calibration, calibration, "calibration").gain_nm_per_v
        provenance["torque_gain_nm_per_v"] = _origin(calibration, "calibration")
    try:
        return replace(
            base,
            name=base.name if base.name.startswith(_PREFIX) else _PREFIX + base.name,
            blocks=blocks,
            measurement_noise=r,
            use_measured_angle=True,
            provenance=provenance,
            torque_gain_nm_per_v=gain,
        )
    except ValueError as error:
        raise _bad(str(error), "stored results") from error


def _bad(what: str, where: str) -> DataError:
    return DataError(what, where=where, fix="evaluate that run again and feed its result.json")


def _origin(result: Mapping[str, Any], kind: str) -> str:
    text = json.dumps(result, sort_keys=True, separators=(",", ":"), default=str)
    digest = hashlib.sha256(text.encode()).hexdigest()
    run = next((str(result[key]) for key in ("run", "run_id", "source") if result.get(key)), None)
    return f"{kind} result{f' of {run}' if run else ''}, sha256 {digest}"


def _own_noise(
    before: tuple[OscillatorBlock, ...], after: tuple[OscillatorBlock, ...]
) -> tuple[OscillatorBlock, ...]:
    """Return `after` with the tuned noise: of the same order, else of the first of its role."""
    found = []
    for block in after:
        like = [b for b in before if b.role == block.role] or list(before)
        # relative rounding of 1/N written and read again
        same = [b for b in like if abs(b.order - block.order) <= 1e-9 * block.order]
        template = (same or like)[0]
        found.append(
            replace(block, process_noise=template.process_noise, noise_per=template.noise_per)
        )
    return tuple(found)


def _with_ripple(
    blocks: tuple[OscillatorBlock, ...], result: _Ripple, r: float
) -> tuple[tuple[OscillatorBlock, ...], float]:
    """Return blocks and R after a ripple result; `r` is R before it."""
    new_r = r if result.filter.measurement_noise is None else result.filter.measurement_noise
    scaled = tuple(replace(b, process_noise=b.process_noise * new_r / r) for b in blocks)
    q = result.filter.process_noise
    if q is None:
        q = next((block for block in scaled if block.role == "ripple"), scaled[0]).process_noise
    found = tuple(OscillatorBlock(entry.order, "ripple", q) for entry in result.ripple)
    kept = tuple(block for block in scaled if block.role != "ripple" or block.frequency_hz > 0.0)
    return found + kept, new_r


def _with_misalignment(
    blocks: tuple[OscillatorBlock, ...], added: _Block, r: float
) -> tuple[OscillatorBlock, ...]:
    """Return the blocks after a misalignment result, its Q brought to the scale of `r`."""
    template = next((block for block in blocks if block.role == "misalignment"), blocks[-1])
    q = template.process_noise
    if added.process_noise is not None:
        q = added.process_noise
        if added.measurement_noise is not None:
            q *= r / added.measurement_noise
    block = OscillatorBlock(added.order, "misalignment", q)
    # relative rounding of 1/N written and read again
    kept = tuple(b for b in blocks if abs(b.order - block.order) > 1e-9 * block.order)
    return (*kept, block)
