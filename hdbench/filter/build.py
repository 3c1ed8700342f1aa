"""Stored results of the three experiments, fed into a filter model."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hdbench.errors import DataError
from hdbench.filter.model import FilterModel, OscillatorBlock

__all__ = ["build_filter_model"]

_PREFIX = "results-on-"


def build_filter_model(
    base: FilterModel,
    *,
    ripple: Mapping[str, Any] | None = None,
    misalignment: Mapping[str, Any] | None = None,
    calibration: Mapping[str, Any] | None = None,
) -> FilterModel:
    """Feed stored results into a filter model.

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
        added = _with_misalignment(blocks, misalignment, r)
        blocks = _own_noise(blocks, added) if tuned else added
        provenance["misalignment block"] = _origin(misalignment, "misalignment")
    if ripple is not None:
        added, new_r = _with_ripple(blocks, ripple, r)
        blocks, r = (_own_noise(blocks, added), r) if tuned else (added, new_r)
        provenance["ripple blocks, measurement_noise"] = _origin(ripple, "ripple")
    if calibration is not None:
        gain = _finite(calibration, "gain_nm_per_v", "calibration result")
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


def _number(body: object, key: str, where: str) -> float:
    value = _finite(body, key, where)
    if not value > 0.0:
        raise _bad(f"{key} is {value!r}; needed: above 0", where)
    return value


def _finite(body: object, key: str, where: str) -> float:
    if not isinstance(body, Mapping):
        raise _bad(f"found {repr(body)[:60]}; needed: an object with {key}", where)
    entry = body.get(key)
    value = entry.get("value") if isinstance(entry, Mapping) else entry
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _bad(f"{key} is {entry!r}; needed: a number or {{value, std, dof}}", where)
    if not math.isfinite(value):
        raise _bad(f"{key} is {value!r}; needed: a finite number", where)
    return float(value)


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
    blocks: tuple[OscillatorBlock, ...], result: Mapping[str, Any], r: float
) -> tuple[tuple[OscillatorBlock, ...], float]:
    """Return blocks and R after a ripple result; `r` is R before it."""
    entries = result.get("ripple")
    if not isinstance(entries, list) or not entries:
        raise _bad("key ripple is no list of orders", "ripple result")
    noise = result.get("filter", {})
    where = "ripple result:filter"
    if not isinstance(noise, Mapping):
        raise _bad("key filter is no object", where)
    new_r = _number(noise, "measurement_noise", where) if "measurement_noise" in noise else r
    scaled = tuple(replace(b, process_noise=b.process_noise * new_r / r) for b in blocks)
    q = next((block for block in scaled if block.role == "ripple"), scaled[0]).process_noise
    if "process_noise" in noise:
        q = _number(noise, "process_noise", where)
    found = tuple(
        OscillatorBlock(_number(entry, "order", f"ripple result:ripple[{i}]"), "ripple", q)
        for i, entry in enumerate(entries)
    )
    kept = tuple(block for block in scaled if block.role != "ripple" or block.frequency_hz > 0.0)
    return found + kept, new_r


def _with_misalignment(
    blocks: tuple[OscillatorBlock, ...], result: Mapping[str, Any], r: float
) -> tuple[OscillatorBlock, ...]:
    """Return the blocks after a misalignment result, its Q brought to the scale of `r`."""
    entry = result.get("filter")
    if not isinstance(entry, Mapping):
        raise _bad("key filter, the block to add, is missing", "misalignment result")
    where = "misalignment result:filter"
    template = next((block for block in blocks if block.role == "misalignment"), blocks[-1])
    q = template.process_noise
    if "process_noise" in entry:
        q = _number(entry, "process_noise", where)
        if "measurement_noise" in entry:
            q *= r / _number(entry, "measurement_noise", where)
    block = OscillatorBlock(_number(entry, "order", where), "misalignment", q)
    # relative rounding of 1/N written and read again
    kept = tuple(b for b in blocks if abs(b.order - block.order) > 1e-9 * block.order)
    return (*kept, block)
