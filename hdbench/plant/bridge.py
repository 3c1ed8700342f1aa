"""Strain gauges on the flexspline in one Wheatstone bridge (report, equations 1-4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.profile.schema import HarmonicParameters, Sensor
from hdbench.records.trace import FloatArray

# Report, figure 2: four rosettes, 90 degrees apart.
PAIR_ANGLES_RAD = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)

# A gauge that sits further off than this would have been seen through the microscope that the
# report uses; ripple that needs more is torque in the mesh, not misplacement.
MAX_PLACEMENT_ERROR_RAD = math.radians(10.0)


@dataclass(frozen=True, slots=True)
class GaugeBridge:
    r"""Rosettes on the flexspline, wired into one bridge with its amplifier.

    With :math:`\beta` the wave-generator angle relative to the first rosette, a rosette at
    :math:`\varphi + \delta` has the strain difference

    .. math:: \epsilon_1 - \epsilon_2 = 2 \epsilon_t + \Psi_0 [\sin 2 (\beta - \varphi - \delta)
              + h \sin(4 (\beta - \varphi - \delta) + \chi)]

    which is the report's equation 2 for :math:`\varphi = 0` and equation 3 for 90 degrees, there
    without :math:`\delta` and h. Equation 4 takes a quarter of the sum over two rosettes; n of
    them in one bridge give :math:`1 / 2 n` of their sum. Misplaced by :math:`\delta`, one of two
    leaves :math:`A \sin \delta` of the amplitude :math:`A = \Psi_0 / 2` that a single one shows,
    one of four leaves half of that. The harmonic is not cancelled by 90 degree spacing.
    """

    volt_per_strain: float
    strain_per_nm: float
    wave_strain: float
    wave_harmonic: float
    wave_harmonic_phase_rad: float
    mounting_rad: float
    placement_error_rad: tuple[float, ...]

    def rosette_strains(self, torque_nm: FloatArray, wave_angle_rad: FloatArray) -> FloatArray:
        """Return the strain difference of every rosette."""
        torsion = 2.0 * self.strain_per_nm * torque_nm
        beta = wave_angle_rad - self.mounting_rad
        strains = []
        for place, error in zip(PAIR_ANGLES_RAD, self.placement_error_rad, strict=True):
            at = 2.0 * (beta - place - error)
            wave = np.sin(at) + self.wave_harmonic * np.sin(2.0 * at + self.wave_harmonic_phase_rad)
            strains.append(torsion + self.wave_strain * wave)
        return np.array(strains)

    def output_v(self, torque_nm: FloatArray, wave_angle_rad: FloatArray) -> FloatArray:
        """Return the amplified output of the bridge (equation 4)."""
        strains = self.rosette_strains(torque_nm, wave_angle_rad)
        total: FloatArray = strains.sum(axis=0)
        return total * (self.volt_per_strain / (2.0 * len(PAIR_ANGLES_RAD)))


def place_gauges(
    sensor: Sensor, ripple: tuple[HarmonicParameters, ...]
) -> tuple[GaugeBridge, tuple[HarmonicParameters, ...]]:
    r"""Return the bridge whose misplaced gauges leave the profile's ripple at orders 2 and 4.

    The second axis (rosettes at 90 and 270 degrees) sits :math:`\delta` off. The sum then is
    :math:`A \sin\delta \cos(2 \beta - \delta) + A h \cos 2\delta \sin(4 \beta - 2 \delta + \chi)`,
    which is solved for :math:`\delta`, the mounting angle, h and :math:`\chi`.
    """
    volt_per_strain = sensor.amplifier_gain * sensor.excitation_v * sensor.gauge_factor
    nm_per_strain = sensor.gain_nm_per_v * volt_per_strain
    single_nm = 0.5 * sensor.wave_strain * nm_per_strain
    chosen = {2.0: _first(ripple, 2.0), 4.0: _first(ripple, 4.0)}
    largest_nm = single_nm * math.sin(MAX_PLACEMENT_ERROR_RAD)
    for order, component in chosen.items():
        if component is not None and component.amplitude_nm > largest_nm:
            chosen[order] = None
    second, fourth = chosen[2.0], chosen[4.0]
    delta = math.asin(second.amplitude_nm / single_nm) if second and largest_nm > 0.0 else 0.0
    mounting = -0.5 * (second.phase_rad + delta) if second else 0.0
    harmonic, phase = 0.0, 0.0
    if fourth and largest_nm > 0.0:
        harmonic = fourth.amplitude_nm / (single_nm * math.cos(2.0 * delta))
        phase = fourth.phase_rad + 4.0 * mounting + 2.0 * delta + 0.5 * math.pi
    bridge = GaugeBridge(
        volt_per_strain=volt_per_strain,
        strain_per_nm=1.0 / nm_per_strain,
        wave_strain=sensor.wave_strain,
        wave_harmonic=harmonic,
        wave_harmonic_phase_rad=phase,
        mounting_rad=mounting,
        placement_error_rad=(0.0, delta, 0.0, delta),
    )
    explained = [id(component) for component in (second, fourth) if component is not None]
    return bridge, tuple(part for part in ripple if id(part) not in explained)


def _first(ripple: tuple[HarmonicParameters, ...], order: float) -> HarmonicParameters | None:
    """Return the first component of `order`, if there is one."""
    return next((part for part in ripple if part.order == order), None)
