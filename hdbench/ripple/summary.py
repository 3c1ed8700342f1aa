"""From the joint fit of a ripple run to its result."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hdbench.estimation.channel import DataFlag, data_flags
from hdbench.estimation.harmonics import Harmonic, harmonic_at, scaled
from hdbench.estimation.regression import ordinary_fit
from hdbench.estimation.spectrum import amplitude_spectrum, find_peaks
from hdbench.estimation.stretches import SteadyStretch, longest_steady
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import TorqueScale
from hdbench.records.trace import FloatArray
from hdbench.ripple.record import Record
from hdbench.ripple.regression import Regression
from hdbench.ripple.result import RippleOrder, RippleResult, SteadySpectrum, VelocityRange

__all__ = ["summarise"]

# blocks over which the wander of the amplitudes is judged, and cycles of the lowest order in each
_BLOCKS = 8
_CYCLES_PER_BLOCK = 5.0
# an amplitude left in the filtered torque is seen above so many of its standard uncertainties
_SEEN_SIGMA = 2.0
# an order is called off its nominal value outside this interval: once in a thousand by chance
_OFF_CONFIDENCE = 0.999
# a steadier stretch is preferred as long as it holds this many motor turns: order resolution 0.05
_SPECTRUM_TURNS = 20.0
_STEADIER = (0.1, 0.3, 1.0)


def summarise(
    record: Record,
    regression: Regression,
    profile: ProfileData,
    scale: TorqueScale,
    filter_name: str,
) -> RippleResult:
    """Return the result of a ripple run from its joint fit."""
    used, fit = record.used, regression.found.fit
    velocity = record.motion.velocity_rad_s[used]
    time = record.motion.time_s[used]
    relative, dof = scale.relative_std, scale.gain_nm_per_v.dof
    wander, origin = _wander(record, regression)
    first = regression.n_slow + 2 * len(regression.orders)
    output = [
        _with_scale(harmonic_at(fit, first + 2 * i), scale)
        for i in range(len(regression.output_orders))
    ]
    filtered = regression.filtered_nm[used]
    return RippleResult(
        ripple=_components(regression, scale),
        lines=tuple(line.scaled(relative, dof) for line in regression.found.lines),
        motor_velocity_rad_s=VelocityRange(
            float(velocity.mean()),
            float(velocity.std()),
            float(velocity.min()),
            float(velocity.max()),
        ),
        torque_rms_measured_nm=_rms(record.torque_nm[used]),
        torque_rms_filtered_nm=_rms(filtered[np.isfinite(filtered)]),
        spectrum=_spectrum(record, regression, profile),
        misalignment=output[0] if output else None,
        output_order_2=output[1] if len(output) > 1 else None,
        trend=regression.trend,
        noise=fit.noise,
        residual_rms_nm=fit.rms,
        process_noise=wander,
        process_noise_origin=origin,
        from_s=float(time[0]),
        to_s=float(time[-1]),
        angle_source=record.motion.angle_source,
        angle_scale=regression.angle_scale,
        scale=scale,
        filter_name=filter_name,
        flags=data_flags(record.trace, record.torque_nm, profile),
        notes=_notes(record, regression),
        n_samples=fit.n_samples,
    )


def _rms(torque_nm: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(torque_nm))))


def _with_scale(component: Harmonic, scale: TorqueScale) -> Harmonic:
    amplitude = scaled(component.amplitude, scale.relative_std, scale.gain_nm_per_v.dof)
    return replace(component, amplitude=amplitude)


def _components(regression: Regression, scale: TorqueScale) -> tuple[RippleOrder, ...]:
    entries = []
    for i, order in enumerate(regression.orders):
        column = regression.n_slow + 2 * i
        here = harmonic_at(regression.found.fit, column)
        left = harmonic_at(regression.filtered, column).amplitude
        bound = not left.value > _SEEN_SIGMA * left.std
        after = left.std if bound else left.value
        both = not here.small and after > 0.0
        entries.append(
            RippleOrder(
                order=order,
                order_estimate=regression.estimates[i],
                component=_with_scale(here, scale),
                suppression_db=20.0 * math.log10(here.amplitude.value / after) if both else None,
                suppression_is_bound=bound,
            )
        )
    return tuple(entries)


def _notes(record: Record, regression: Regression) -> tuple[DataFlag, ...]:
    notes, n_samples = [], regression.found.fit.n_samples
    velocity = record.motion.velocity_rad_s[record.used]
    if record.motion.angle_source == "velocity" and velocity.min() < 0.0 < velocity.max():
        step = float(np.median(np.diff(record.motion.time_s)))
        lag = 0.5 * float(np.max(np.abs(velocity))) * step
        detail = (
            "the angle was integrated sample by sample: half a sample is up to "
            f"{lag:.3g} rad of motor angle, with opposite signs in the two directions"
        )
        notes.append(DataFlag("integrated-angle", n_samples, detail))
    if regression.angle_scale is not None:
        detail = f"the integrated angle was scaled by {regression.angle_scale.value:.5g}"
        notes.append(DataFlag("velocity-scale", n_samples, detail))
        return tuple(notes)
    for order, estimate in zip(regression.orders, regression.estimates, strict=True):
        if estimate is None:
            continue
        low, high = estimate.interval(_OFF_CONFIDENCE)
        if not low <= order <= high:
            detail = f"order {order:g} measures {estimate.value:.5g} in this record"
            notes.append(DataFlag("order-off-nominal", n_samples, detail))
    return tuple(notes)


def _spectrum(
    record: Record, regression: Regression, profile: ProfileData
) -> SteadySpectrum | None:
    motion = record.motion
    gaps = record.starts.copy()
    # no spectrum reaches across a gap; the first sample follows none
    gaps[0] = False
    found = None
    for share in _STEADIER:
        found = longest_steady(
            motion.time_s,
            motion.velocity_rad_s,
            record.used & ~gaps,
            tolerance=share * profile.ripple.steady_tolerance,
        )
        if found is not None and _motor_turns(record, found) >= _SPECTRUM_TURNS:
            break
    if found is None:
        return None
    part = slice(found.start, found.stop)
    slow = (
        regression.found.design[part, : regression.n_slow]
        @ regression.found.fit.coefficients[: regression.n_slow]
    )
    spectrum = amplitude_spectrum(
        record.torque_nm[part] - slow, float(np.median(np.diff(motion.time_s[part])))
    )
    # the names of the report: the ripple's place as a multiple of the motor velocity
    names = {f"{order:g}x": order for order in regression.orders}
    peaks = find_peaks(spectrum, found.velocity_rad_s, names)
    return SteadySpectrum(found, spectrum, peaks)


def _motor_turns(record: Record, stretch: SteadyStretch) -> float:
    angle = record.motion.angle_rad
    return abs(float(angle[stretch.stop - 1] - angle[stretch.start])) / (2.0 * math.pi)


def _wander(record: Record, regression: Regression) -> tuple[float, str]:
    """Return the process noise per sample that the change of the amplitudes along the run shows.

    Blocks of L samples each give amplitudes with variance v; for a random walk with variance q
    per sample the difference of neighbouring block means has variance 2 q L / 3 + 2 v.
    """
    used, fit = record.used, regression.found.fit
    index = np.flatnonzero(used)
    first = regression.n_slow
    columns = regression.found.design[:, first : first + 2 * len(regression.orders)]
    rest = np.delete(
        np.arange(regression.found.design.shape[1]), np.arange(first, first + columns.shape[1])
    )
    response = (
        record.torque_nm
        - record.expected_nm
        - regression.found.design[:, rest] @ fit.coefficients[rest]
    )
    travelled = np.abs(np.diff(record.motion.angle_rad[index])).sum() / (2.0 * math.pi)
    blocks = min(_BLOCKS, int(travelled * min(regression.orders) / _CYCLES_PER_BLOCK))
    whole = math.sqrt(max(float(np.mean(np.diag(fit.covariance)[first : first + 2])), 0.0))
    floor = max(whole**2 / fit.n_samples, np.finfo(float).tiny)
    least = "smallest that the record could show: its amplitudes do not wander measurably"
    if blocks < 3:
        return floor, "smallest that the record could show: too short to see amplitudes wander"
    fits = []
    for part in np.array_split(index, blocks):
        try:
            fits.append(ordinary_fit(columns[part], response[part]))
        except ValueError:
            return floor, least
    values = np.array([f.coefficients for f in fits])
    spread = float(np.mean(np.diff(values, axis=0) ** 2))
    own = float(np.mean([np.diag(f.covariance) for f in fits]))
    walk = (spread - 2.0 * own) * 1.5 / (len(index) / blocks)
    if not walk > floor:
        return floor, least
    return walk, f"wander of the amplitudes over {blocks} blocks of the record"
