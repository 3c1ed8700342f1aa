"""Limits of a tuning: memory of the blocks, refused slow torque, numbers that stay unknown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hdbench.errors import DataError
from hdbench.filter.model import FilterModel, OscillatorBlock, SlowBlock
from hdbench.filter.response import transfer_at_steady_speed
from hdbench.filter.tuning.problem import OUTPUT_ORDER, Motion
from hdbench.filter.tuning.result import Consistency, Estimate

_TURNS = 2.0  # least turns of a block's own order that tell its wander from a constant or a ramp
_STEADY = 0.02  # spread of speed below which an order and a tone have one frequency
_WHITE = 0.1  # an autocorrelation of which 1 % of the innovations' variance could be foretold
_OFFSET_SHARE = 0.1  # of the density at the slowest order: its estimate is 5 % less certain for it
_HALVINGS = 12  # of the memory's inverse: down to four thousandths
_TORQUE_KEPT = 0.01  # half of what counts as keeping the torque
_NOTCH = 1.25  # within this factor of a block's frequency the torque is what it takes


def slow_density(block: SlowBlock, frequency_hz: float) -> float:
    r"""Return the two-sided power spectral density of a slow torque.

    Notes
    -----
    With :math:`\omega = 2\pi f`: random walk :math:`q/\omega^2`, integrated :math:`q/\omega^4`,
    Ornstein-Uhlenbeck :math:`2 v T / (1 + \omega^2 T^2)`, Matern 3/2
    :math:`4 v T / (1 + \omega^2 T^2)^2`, resonance
    :math:`4 v \omega_0^2 / T / ((\omega_0^2 - \omega^2)^2 + 4 \omega^2 / T^2)`.
    """
    w = 2.0 * math.pi * frequency_hz
    if block.kind == "random-walk":
        return block.noise_per_s / w**2
    if block.kind == "integrated-random-walk":
        return block.noise_per_s / w**4
    t, v = block.time_constant_s, block.variance
    if block.kind == "ornstein-uhlenbeck":
        return 2.0 * v * t / (1.0 + (w * t) ** 2)
    if block.kind == "matern-3/2":
        return 4.0 * v * t / (1.0 + (w * t) ** 2) ** 2
    own = (2.0 * math.pi * block.frequency_hz) ** 2
    return 4.0 * v * own / t / ((own - w * w) ** 2 + 4.0 * w * w / t**2)


def with_moving_offset(model: FilterModel, motion: Motion) -> FilterModel:
    r"""Let the offset move as far as it cannot be taken for the slowest order.

    Notes
    -----
    At standstill misalignment and a constant torque look alike, and a change of load is shared out
    by what is less certain: an offset that hardly moves would leave it to the misalignment. A
    random walk of q per second has the density :math:`q/\omega^2`; it gets a tenth of what noise
    and slow torque have together at the slowest order's :math:`\omega`.
    """
    slowest = min((b.order for b in model.blocks if b.order > 0.0), default=0.0)
    w = slowest * motion.speed_rad_s
    if not (w > 0.0 and model.slow):
        return model
    offset, *others = model.slow
    density = model.measurement_noise * motion.period_s
    density += sum(slow_density(block, w / (2.0 * math.pi)) for block in others)
    noise = max(offset.noise_per_s, _OFFSET_SHARE * density * w * w)
    return replace(model, slow=(replace(offset, noise_per_s=noise), *others))


def forget_beyond_the_data(
    model: FilterModel, estimates: Sequence[Estimate], motion: Motion
) -> tuple[FilterModel, tuple[Estimate, ...]]:
    """Raise process noise that the data do not determine until memory is as long as the data.

    Notes
    -----
    A constant amplitude in a minute of data says nothing about the next hour. In noise of density
    S per radian a block of process noise q per radian forgets within sqrt(2 S / q) radians; it is
    set to the angle that the motor turned in the traces. Where that would change torque between
    0.5 and 10 Hz, or constant torque, by more than 1 % at a speed of the traces, it forgets less.
    """
    floors = {
        i: floor
        for i, block in enumerate(model.blocks)
        if estimates[1 + i].relative_std is None
        and (floor := _floor(model, block, motion)) > block.process_noise
    }
    raised = model
    for halving in range(_HALVINGS):
        share = 0.25**halving
        least = {i: max(model.blocks[i].process_noise, f * share) for i, f in floors.items()}
        raised = _with_noise(model, least)
        if _same_torque(model, raised, motion):
            break
    else:
        raised = model
    found = list(estimates)
    for i in floors:
        if raised.blocks[i].process_noise > model.blocks[i].process_noise:
            value = raised.blocks[i].process_noise
            found[1 + i] = replace(estimates[1 + i], value=value, held=True)
    return raised, tuple(found)


def leave_the_torque(
    model: FilterModel, estimates: Sequence[Estimate], motion: Motion
) -> tuple[FilterModel, tuple[Estimate, ...]]:
    """Lower process noise at orders of the output until they leave the torque alone.

    Notes
    -----
    Where the slow torque is none of the kinds tried, the likelihood gives a part of it to the
    misalignment. What its block takes of the torque between 0.5 and 10 Hz, or of constant torque,
    is held to 1 % more than it takes with a memory as long as the traces, at their speeds.
    """
    found, kept = list(estimates), model
    for i, block in enumerate(model.blocks):
        if not 0.0 < block.order < OUTPUT_ORDER:
            continue
        least = min(_floor(model, block, motion), block.process_noise)
        long = _with_noise(kept, {i: least})
        noise = block.process_noise
        while noise > least and not _same_torque(long, _with_noise(kept, {i: noise}), motion):
            noise = max(0.5 * noise, least)
        if noise < block.process_noise:
            kept = _with_noise(kept, {i: noise})
            found[1 + i] = replace(found[1 + i], value=noise, lowered=True)
    return kept, tuple(found)


def _with_noise(model: FilterModel, noise: Mapping[int, float]) -> FilterModel:
    """Return the model with other process noise in some blocks, by their place."""
    blocks = [
        replace(block, process_noise=noise.get(i, block.process_noise))
        for i, block in enumerate(model.blocks)
    ]
    return replace(model, blocks=tuple(blocks))


def _same_torque(model: FilterModel, raised: FilterModel, motion: Motion) -> bool:
    """Return whether both pass torque away from the notches alike, at the traces' speeds."""
    for speed in (motion.slowest_rad_s, motion.speed_rad_s, motion.fastest_rad_s):
        if not speed > 0.0:
            continue
        hz = np.concatenate(([0.0], np.geomspace(0.5, 10.0, 40)))
        hz = hz[hz < 0.5 / motion.period_s]
        for block in model.blocks:
            own = block.frequency_at(speed)
            hz = hz[(hz < own / _NOTCH) | (hz > own * _NOTCH)]
        try:
            change = transfer_at_steady_speed(raised, speed, motion.period_s, hz)
            change = change - transfer_at_steady_speed(model, speed, motion.period_s, hz)
        except DataError:  # a tone and an order of one frequency at just this speed
            continue
        if not (np.abs(change) <= _TORQUE_KEPT).all():
            return False
    return True


def _floor(model: FilterModel, block: OscillatorBlock, motion: Motion) -> float:
    """Process noise, per radian or second, of a memory as long as the traces."""
    hz, rate, whole = block.frequency_at(motion.speed_rad_s), 1.0, motion.duration_s
    if block.order > 0.0:
        rate, whole = motion.speed_rad_s, motion.turned_rad
    if not (hz > 0.0 and whole > 0.0):
        return 0.0
    density = model.measurement_noise * motion.period_s
    density += sum(slow_density(slow, hz) for slow in model.slow)
    return 2.0 * density * rate / whole**2


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
    slow: str,
    consistency: Consistency,
) -> tuple[str, ...]:
    """Return what the data cannot determine, one line each."""
    notes = [*_motion_notes(model, motion), *map(_estimate_note, estimates)]
    if slow in ("random-walk", "integrated-random-walk"):
        notes.append(
            f"{slow}: unbounded variance near the output speed, so it takes misalignment "
            "for torque wherever the disturbance is none; a stationary kind does not"
        )
    if slow == "none":
        notes.append(
            "slow none: a torque unknown to the expected torque is taken for ripple or misalignment"
        )
    correlation = consistency.whiteness.largest_autocorrelation
    if not abs(correlation) < _WHITE:
        notes.append(
            f"innovations are not white (autocorrelation {correlation:+.2f}): "
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
