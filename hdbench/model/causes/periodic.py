"""Causes of one period: locked to the motor, to the output, to the clock."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._parts import (
    REFERENCE_LOAD_NM,
    REFERENCE_SPEED_RAD_S,
    Columns,
    Computed,
    Shape,
    all_of,
    broken_orders,
    lasts,
    loaded,
    lobe_angle,
    motor_turns,
    output_turns,
    pair,
    whole_orders,
)
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

# of a three-phase motor with m pole pairs: m and 2 m by the currents (offset, unequal phases) and
# the poles, 3 m by the slots of each pole, 6 m by the six steps of the windings; 24 poles with 18
# slots have 12, 24, 36 and 72
_OF_POLES = (1, 2, 3, 6)
# orders 1, 2 and 4 are those of the wave generator and its lobes; the orders of a servo motor's
# poles and slots stay below the highest order of a ripple
_FIRST_OF_POLES, _LAST_OF_POLES, _LOBES = 3, 60, (4,)
# output turns on which a torque once per turn bends enough to be told from a zero and a drift
_ARC = 0.25
# European and American mains keep within 1 % of nominal; a record's own clock is far better
_MAINS_BANDS = ((49.5, 50.5), (59.5, 60.5))


def _speed_share(motion: Motion) -> FloatArray:
    return motion.velocity_rad_s / REFERENCE_SPEED_RAD_S


def _load_share(motion: Motion) -> FloatArray:
    return motion.applied_nm / REFERENCE_LOAD_NM


def _beat(motion: Motion, _: Shape) -> FloatArray:
    carrier = lobe_angle(motion)
    lower, upper = carrier - motion.output_angle_rad, carrier + motion.output_angle_rad
    return np.hstack((pair(lower), pair(upper)))


def _multiples(*factors: float) -> Columns:
    """Return the columns of an order and of multiples of it."""

    def columns(motion: Motion, shape: Shape) -> FloatArray:
        angle = shape["order"] * motion.angle_rad
        return np.hstack([pair(k * angle) for k in factors])

    return columns


def _needs_measured_angle(motion: Motion) -> str | None:
    if motion.angle_source != "velocity":
        return None
    return (
        "the motor angle is an integral of the velocity, too coarse for tooth mesh; needed: "
        "motor_angle_rad or encoder_count"
    )


def _once(motion: Motion, _: Shape) -> FloatArray:
    return pair(motion.output_angle_rad)


def _twice(motion: Motion, _: Shape) -> FloatArray:
    return pair(2.0 * motion.output_angle_rad)


def _position_gain(motion: Motion, _: Shape) -> FloatArray:
    share, angle = _load_share(motion), motion.output_angle_rad
    return np.hstack((pair(angle, share), pair(2.0 * angle, share)))


def _tone(motion: Motion, shape: Shape) -> FloatArray:
    return pair(2.0 * np.pi * shape["frequency_hz"] * motion.time_s)


def _mains_applicable(motion: Motion) -> str | None:
    steps = np.diff(motion.time_s)
    rate = 1.0 / float(np.median(steps)) if len(steps) else 0.0
    if rate > 2.0 * _MAINS_BANDS[0][1]:
        return None
    return f"{rate:.4g} samples/s; needed: more than {2.0 * _MAINS_BANDS[0][1]:g} to see 50 Hz"


COMPUTED = {
    "ripple-harmonic": Computed(lambda m, s: pair(s["order"] * m.angle_rad), motor_turns(1.0)),
    "wave-generator-eccentricity": Computed(lambda m, _: pair(m.angle_rad), motor_turns(1.0)),
    "motor-unbalance": Computed(
        lambda m, _: pair(m.angle_rad, _speed_share(m) ** 2), motor_turns(1.0)
    ),
    "ripple-beat": Computed(_beat, output_turns(1.0)),
    "tooth-mesh": Computed(
        lambda m, _: pair(2.0 * (m.gear_ratio + 1.0) * m.angle_rad),
        all_of(motor_turns(1.0), _needs_measured_angle),
    ),
    "bearing-defect": Computed(
        _multiples(1.0, 2.0, 3.0), motor_turns(100.0), bands=broken_orders(0.2, 20)
    ),
    "cogging": Computed(
        _multiples(*_OF_POLES),
        motor_turns(1.0),
        bands=whole_orders(_FIRST_OF_POLES, _LAST_OF_POLES, without=_LOBES),
    ),
    "load-dependent-ripple": Computed(
        lambda m, _: pair(lobe_angle(m), np.abs(m.applied_nm) / REFERENCE_LOAD_NM),
        all_of(motor_turns(1.0), loaded),
    ),
    "gain-ripple": Computed(
        lambda m, _: pair(lobe_angle(m), _load_share(m)), all_of(motor_turns(1.0), loaded)
    ),
    "misalignment": Computed(_once, output_turns(_ARC)),
    "angular-misalignment": Computed(_twice, output_turns(0.5)),
    "load-gravity": Computed(_once, output_turns(_ARC)),
    "position-dependent-gain": Computed(_position_gain, loaded),
    "mains-hum": Computed(_tone, _mains_applicable, bands=_MAINS_BANDS),
    "structural-tone": Computed(_tone, lasts(1.0)),
}
