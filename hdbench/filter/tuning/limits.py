"""What the data cannot determine, and which slow torque would eat an order."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hdbench.filter.model import FilterModel
from hdbench.filter.tuning.checks import Consistency
from hdbench.filter.tuning.data import OUTPUT_ORDER, Motion
from hdbench.filter.tuning.result import Estimate
from hdbench.filter.tuning.settings import TuningSettings

__all__ = ["notes_on", "refusal"]

_TURNS = 2.0  # least turns of a block's own order that tell its wander from a constant or a ramp
_STEADY = 0.02  # spread of speed below which an order and a tone have one frequency
_WHITE = 0.1  # an autocorrelation of which 1 % of the innovations' variance could be foretold


def refusal(model: FilterModel, motion: Motion) -> str | None:
    """Return why a slow torque is not eligible, or None.

    Notes
    -----
    At constant speed a resonance near the frequency of an order is that order under another name:
    kept in the filtered torque, it would keep the ripple or misalignment.
    """
    if motion.speed_spread > _STEADY:
        return None
    for slow in model.slow:
        if slow.kind != "resonance":
            continue
        width = 1.0 / (2.0 * math.pi * slow.time_constant_s)
        for block in model.blocks:
            hz = block.order * motion.speed_rad_s / (2.0 * math.pi)
            if hz > 0.0 and abs(slow.frequency_hz - hz) < 0.5 * hz + width:
                return (
                    f"resonance at {slow.frequency_hz:.3g} Hz lies at order {block.order:g} "
                    f"({hz:.3g} Hz) of a constant speed"
                )
    return None


def notes_on(
    model: FilterModel,
    motion: Motion,
    estimates: Sequence[Estimate],
    settings: TuningSettings,
    consistency: Consistency,
) -> tuple[str, ...]:
    """Return what the data cannot determine, one line each."""
    notes = [*_motion_notes(model, motion), *map(_estimate_note, estimates)]
    if settings.slow in ("random-walk", "integrated-random-walk"):
        notes.append(
            f"{settings.slow}: unbounded variance near the output speed, so it takes misalignment "
            "for torque wherever the disturbance is none; a stationary kind does not"
        )
    if settings.slow == "none":
        notes.append(
            "slow none: a torque unknown to the expected torque is taken for ripple or misalignment"
        )
    if not abs(consistency.largest_correlation) < _WHITE:
        notes.append(
            f"innovations are not white (autocorrelation {consistency.largest_correlation:+.2f}): "
            "something regular is not in the model; `hdbench orders` shows it, `hdbench diagnose` "
            "names it, --order or --model with the extended model takes it in"
        )
    return tuple(note for note in notes if note)


def _motion_notes(model: FilterModel, motion: Motion) -> list[str]:
    notes = []
    for block in model.blocks:
        turns = block.order * motion.turned_rad / (2.0 * math.pi)
        if block.order > 0.0 and turns < _TURNS:
            what = "output turns" if block.order < OUTPUT_ORDER else "turns of its own"
            notes.append(
                f"order {block.order:g}: {turns:.2g} {what}, needed {_TURNS:g}: its process noise "
                "is not determined and its estimate is held by the prior"
            )
    tones = any(b.frequency_hz > 0.0 for b in model.blocks) or any(
        s.kind == "resonance" for s in model.slow
    )
    if motion.speed_spread < _STEADY and motion.speed_rad_s > 0.0:
        told = "orders and tones cannot be told apart" if tones else "orders look like tones"
        notes.append(
            f"constant speed ({motion.speed_rad_s:.4g} rad/s, spread "
            f"{100.0 * motion.speed_spread:.2g} %): {told}; tune on a trace of changing speed"
        )
    return notes


def _estimate_note(estimate: Estimate) -> str:
    if estimate.lowered:
        return (
            f"{estimate.name}: less than likely, {estimate.value:.3g} {estimate.unit}: more would "
            "take over 1 % of the torque between 0.5 and 10 Hz"
        )
    if estimate.determined:
        return ""
    if estimate.relative_std is not None:
        factor = math.exp(estimate.relative_std)
        return f"{estimate.name}: known to a factor of {factor:.2g} only"
    limit = " or ".join(
        f"{word} {value:.3g} {estimate.unit}"
        for word, value in (("below", estimate.below), ("above", estimate.above))
        if value is not None
    )
    held = "; set so that it forgets within the traces, as far as that leaves the torque alone"
    return (
        f"{estimate.name}: not determined by these traces{': ' + limit if limit else ''}"
        f"{held if estimate.held else ''}"
    )
