"""Effects of misplaced rosettes on gain, zero and ripple."""

from __future__ import annotations

import math

import numpy as np

from hdbench.gauges.strain import GaugedBench, PlacementErrors, Wave, grid_strain, torque_reading
from hdbench.records.trace import FloatArray

# every strain has even orders of the wave generator only: half a turn is a period. 16 points tell
# orders 0 to 14 apart; the bridge's products of orders 2 and 4 above that are below 1e-15
_POINTS = 16
# draws evaluated at once: 20 MB of strains
_CHUNK = 2000


def placement_effects(bench: GaugedBench, errors: PlacementErrors) -> dict[str, FloatArray]:
    """Return what placement errors do, by the exact bridge equation.

    Parameters
    ----------
    bench : GaugedBench
        Flexspline, gauges, sensor.
    errors : PlacementErrors
        One row per draw.

    Returns
    -------
    dict of ndarray, shape (draws,)
        Relative change of the torque shown at rated torque, mean over a turn, zero taken off;
        at no torque, N m: the mean over a turn of the wave generator, the largest with that locked
        at any angle, and the amplitudes at twice and at four times its speed.
    """
    draws = len(errors.radial_mm)
    parts = [_effects(bench, errors.part(slice(i, i + _CHUNK))) for i in range(0, draws, _CHUNK)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _effects(bench: GaugedBench, errors: PlacementErrors) -> dict[str, FloatArray]:
    beta: FloatArray = np.arange(_POINTS, dtype=np.float64) * (math.pi / _POINTS)

    def shown(torque_nm: float) -> FloatArray:
        strain = grid_strain(bench, errors, torque_nm=torque_nm, wave_angle_rad=beta)
        return torque_reading(strain, bench.sensor)

    idle = shown(0.0)
    zero = idle.mean(axis=1)
    rated = shown(bench.rated_torque_nm).mean(axis=1)
    lines = np.fft.rfft(idle, axis=1) * (2.0 / _POINTS)
    return {
        "gain_change": (rated - zero) / bench.rated_torque_nm - 1.0,
        "zero_nm": zero,
        "locked_zero_nm": np.abs(idle).max(axis=1),
        "ripple_2_nm": np.abs(lines[:, 1]),
        "ripple_4_nm": np.abs(lines[:, 2]),
    }


def closed_form_ripple(bench: GaugedBench, wave: Wave, error_rad: float) -> float:
    r"""Return the ripple of one rosette that is off along the circumference, linear bridge.

    Parameters
    ----------
    bench : GaugedBench
        Flexspline, gauges, sensor; its layout cancels the wave.
    wave : Wave
        One order of the wave generator's strain.
    error_rad : float
        Angle by which one rosette is off, rad.

    Returns
    -------
    float
        Amplitude, N m.

    Notes
    -----
    The other rosettes sum to minus the phasor of this one in place, so
    :math:`\frac{A}{n} |1 - e^{-j m \delta}| = \frac{2 A}{n} \sin \frac{m \delta}{2}`: for order 2
    :math:`A \sin \delta` with two rosettes, :math:`\frac{1}{2} A \sin \delta` with four.
    """
    amplitude = bench.uncancelled_nm(wave)
    share = 2.0 / len(bench.layout.rosettes)
    return share * amplitude * abs(math.sin(0.5 * wave.order * error_rad))
