"""Simulation: the model's torque on a measured motion, or on an ideal motion of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hdbench.errors import UsageError
from hdbench.model.bench import BenchModel
from hdbench.model.cause import check_term
from hdbench.model.causes import CAUSE_GROUPS
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile.schema import ProfileData, ReferenceWave
from hdbench.profile.waves import reference_voltage
from hdbench.records.trace import FloatArray, Trace

# columns of a record that say when and how it moved, and under what load: kept by `simulate_like`
_MOTION_COLUMNS = (
    "time_s",
    "reference_v",
    "motor_velocity_rad_s",
    "tacho_v",
    "motor_angle_rad",
    "encoder_count",
    "output_angle_rad",
    "motor_current_a",
    "load_torque_nm",
    "temperature_c",
)
# longest step of the servo's integration: a fiftieth of the time constant of a 30 Hz velocity loop
_SERVO_STEP_S = 1e-4
# the ideal bench stands in a room that keeps its temperature
_ROOM_C = 20.0
# samples of a run that still fit a gigabyte with all their columns
_MAX_SAMPLES = 10_000_000


def simulate_like(trace: Trace, profile: ProfileData, model: BenchModel) -> Trace:
    """Simulate a model on the motion that a trace holds.

    Parameters
    ----------
    trace : Trace
        A measured trace; needs a velocity.
    profile : ProfileData
        The bench that measured it.
    model : BenchModel
        The model.

    Returns
    -------
    Trace
        Time, motion and load columns of `trace`; ``torque_nm``, N m: the simulated torque without
        noise; ``torque_true_nm``, N m: what of it a filter should keep (zero, expected torque,
        load, friction); NaN at lost samples.

    Raises
    ------
    DataError
        If the trace holds no motion, or a cause of the model does not fit.
    """
    motion = motion_from_trace(trace, profile)
    columns = {name: trace[name] for name in _MOTION_COLUMNS if name in trace}
    columns["torque_nm"] = model.torque_nm(motion)
    columns["torque_true_nm"] = _true_torque_nm(model, motion)
    return Trace(columns, f"simulation like {trace.source}", {"simulated_like": trace.source})


def simulate_run(
    profile: ProfileData,
    model: BenchModel,
    *,
    duration_s: float,
    wave: ReferenceWave,
    noise_nm: float,
    rng: np.random.Generator,
) -> Trace:
    r"""Simulate a run of its own on an ideal motion.

    Parameters
    ----------
    profile : ProfileData
        Servo, sampling period and gear ratio.
    model : BenchModel
        The model.
    duration_s : float
        Length of the run, s; at least five sampling periods.
    wave : ReferenceWave
        Motor reference, V.
    noise_nm : float
        White noise of the torque, N m per sample, at least 0.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    Trace
        ``time_s``, ``reference_v``, ``motor_velocity_rad_s``, ``motor_angle_rad`` (0 at the
        start), ``torque_nm`` and ``torque_true_nm`` (as `simulate_like`); ``motor_current_a`` (of
        the acceleration alone) and ``temperature_c`` (20 degC) where a cause of the model needs
        them.

    Raises
    ------
    UsageError
        If duration or noise is out of its domain.
    DataError
        If a cause of the model does not fit.

    Notes
    -----
    The velocity follows the reference through a first-order lag with an acceleration limit,

    .. math:: \dot\omega = \mathrm{clip}(2 \pi f_b (k u - \omega), \pm\alpha_{max})

    with the servo's gain k, bandwidth and limit, integrated in steps of at most 0.1 ms; the angle
    is the integral of the velocity by the trapezoidal rule. The torque is the model on this motion,
    with the acceleration that `motion_from_trace` forms for a measured one.
    """
    period = profile.daq.sample_period_s
    if not (5.0 * period <= duration_s <= _MAX_SAMPLES * period):
        raise UsageError(
            f"duration {duration_s!r} s; needed: {5.0 * period:g} s to {_MAX_SAMPLES * period:g} s",
            where="duration",
            fix="give a duration in that range",
        )
    time = period * np.arange(round(duration_s / period), dtype=np.float64)
    velocity, angle = _servo(profile, wave, duration_s, len(time))
    trace = Trace(
        {
            "time_s": time,
            "reference_v": reference_voltage(wave, time, duration_s),
            "motor_velocity_rad_s": velocity,
            "motor_angle_rad": angle,
            **_needed_channels(profile, model, velocity),
        },
        f"simulation of {profile.name}",
    )
    motion = motion_from_trace(trace, profile)
    simulated = trace.with_columns(
        torque_nm=model.torque_nm(motion), torque_true_nm=_true_torque_nm(model, motion)
    )
    return with_noise(simulated, noise_nm, rng)


def _true_torque_nm(model: BenchModel, motion: Motion) -> FloatArray:
    """Return zero, expected torque, load and friction: no ripple, misalignment or sensor fault."""
    friction = {cause.name for cause in CAUSE_GROUPS["friction"]}
    kept = tuple(term for term in model.causes if term.name in friction)
    quiet = replace(model, ripple=(), misalignment=(0.0, 0.0), causes=kept)
    true = model.true_motion(motion)
    torque = quiet.baseline_torque_nm(true) + quiet.cause_torque_nm(true)
    return np.where(true.valid, torque, np.nan)


def _needed_channels(
    profile: ProfileData, model: BenchModel, velocity: FloatArray
) -> dict[str, FloatArray]:
    """Return the channels beside the motion that the model's causes need, of an ideal bench."""
    needed = {
        channel
        for term in model.causes
        for channel in check_term(term, where="model", extra=model.extra_causes).channels
    }
    channels = {}
    if "motor_current_a" in needed:
        servo = profile.servo
        slope = np.gradient(velocity, profile.daq.sample_period_s)
        channels["motor_current_a"] = slope * (servo.max_current_a / servo.max_acceleration_rad_s2)
    if "temperature_c" in needed:
        channels["temperature_c"] = np.full(len(velocity), _ROOM_C)
    return channels


def with_noise(trace: Trace, noise_nm: float, rng: np.random.Generator) -> Trace:
    """Return a trace with white noise added to its torque.

    Parameters
    ----------
    trace : Trace
        A trace with ``torque_nm``, N m.
    noise_nm : float
        Standard deviation of the noise, N m per sample, at least 0.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    Trace
        The trace itself where `noise_nm` is 0.

    Raises
    ------
    UsageError
        If `noise_nm` is negative or not finite.
    """
    if not 0.0 <= noise_nm < math.inf:
        raise UsageError(
            f"noise {noise_nm!r} N m; needed: a finite number, at least 0",
            where="noise",
            fix="give 0 for no noise",
        )
    if noise_nm == 0.0:
        return trace
    noise = noise_nm * rng.standard_normal(len(trace))
    noisy = trace.with_columns(torque_nm=trace["torque_nm"] + noise)
    return Trace(noisy.columns, noisy.source, {**noisy.metadata, "noise_nm": noise_nm})


def _servo(
    profile: ProfileData, wave: ReferenceWave, duration_s: float, n_samples: int
) -> tuple[FloatArray, FloatArray]:
    """Return motor velocity, rad/s, and angle, rad, at the samples."""
    period = profile.daq.sample_period_s
    substeps = max(math.ceil(period / _SERVO_STEP_S), 1)
    step = period / substeps
    servo = profile.servo
    time = step * np.arange(n_samples * substeps, dtype=np.float64)
    command = servo.velocity_gain_rad_s_per_v * reference_voltage(wave, time, duration_s)
    # exact share of the way to a constant command within one step
    share = -math.expm1(-2.0 * math.pi * servo.bandwidth_hz * step)
    most = servo.max_acceleration_rad_s2 * step
    velocity = np.empty(len(time))
    now = 0.0
    for index, target in enumerate(command.tolist()):
        velocity[index] = now
        now += min(max(share * (target - now), -most), most)
    increments = 0.5 * step * (velocity[1:] + velocity[:-1])
    angle = np.concatenate(([0.0], np.cumsum(increments)))
    return velocity[::substeps], angle[::substeps]
