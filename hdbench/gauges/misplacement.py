"""Effects of misplaced rosettes on gain, zero and ripple."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.gauges.layout import GridGeometry, Layout
from hdbench.gauges.strain import PlacementErrors, StrainField, Wave, grid_strain, torque_reading
from hdbench.profile.schema import ProfileData, Sensor
from hdbench.records.trace import FloatArray

# every strain has even orders of the wave generator only: half a turn is a period. 16 points tell
# orders 0 to 14 apart; the bridge's products of orders 2 and 4 above that are below 1e-15
_POINTS = 16
# draws evaluated at once: 20 MB of strains
_CHUNK = 2000


@dataclass(frozen=True, slots=True)
class GaugedBench:
    """A flexspline with its gauges, and the sensor that reads them."""

    # the rosettes
    layout: Layout
    # where their grids are
    geometry: GridGeometry
    # the strain under them
    field: StrainField
    # gauge factor, supply, amplifier, gain
    sensor: Sensor
    # torque at which the gain is taken, N m
    rated_torque_nm: float

    def uncancelled_nm(self, wave: Wave) -> float:
        """Return the ripple that all rosettes at one place would show, N m.

        Parameters
        ----------
        wave : Wave
            One order of the wave generator's strain.

        Returns
        -------
        float
            A, N m: half the wave's strain of a pair, read as torsion. Equation 4 with the profile's
            gain; the wave is that of the mean radius.
        """
        return 0.5 * wave.pair_strain / _strain_per_nm(self.sensor)

    def with_strain(
        self,
        second: float | None,
        fourth: float | None,
        normal_share: float,
        assembly: float | None,
    ) -> GaugedBench:
        """Return the bench under other strain.

        Parameters
        ----------
        second, fourth : float or None
            Strain of a pair at order 2 and 4; None keeps it.
        normal_share : float
            Amplitude of normal over shear wave strain.
        assembly : float or None
            Steady radial strain of assembly; None takes that of order 2.

        Returns
        -------
        GaugedBench
        """
        known = {wave.order: wave.pair_strain for wave in self.field.waves}
        strains = {2.0: second, 4.0: fourth}
        waves = tuple(
            Wave(order, known[order] if given is None else given)
            for order, given in strains.items()
        )
        field = replace(
            self.field,
            waves=waves,
            normal_share=normal_share,
            assembly_strain=waves[0].pair_strain if assembly is None else assembly,
        )
        return replace(self, field=field)


def gauged_bench(
    data: ProfileData, layout: Layout, geometry: GridGeometry, field: StrainField | None = None
) -> GaugedBench:
    r"""Return the profile's bench with gauges in place.

    Parameters
    ----------
    data : ProfileData
        Sensor, rated torque and the ripple of its model.
    layout : Layout
        The rosettes.
    geometry : GridGeometry
        Where their grids are.
    field : StrainField or None
        Waves and assembly strain; its torsion is replaced. None takes the profile's wave strain at
        order 2 and, at order 4, the strain that the model's ripple of order 4 stands for.

    Returns
    -------
    GaugedBench
        With the torsion strain that makes the profile's gain true for rosettes in place.

    Notes
    -----
    Equation 4 in volts: :math:`1 / (G\,a\,K\,E_{sup})` strain per N m, G the gain in N m/V and a
    the amplifier's gain. Grids beside the mean radius see :math:`(r_0 / r)^2` of it, which is taken
    off the mean.
    """
    sensor, seen_strain = data.sensor, _strain_per_nm(data.sensor)
    half = 0.5 * geometry.spacing_mm / geometry.radius_mm
    seen = 0.5 * ((1.0 - half) ** -2 + (1.0 + half) ** -2)
    torsion = seen_strain / seen
    if field is None:
        fourth = sum(r.amplitude_nm for r in data.model.ripple if r.order == 4.0)
        waves = (Wave(2.0, sensor.wave_strain), Wave(4.0, 2.0 * seen_strain * fourth))
        field = StrainField(torsion, waves, assembly_strain=sensor.wave_strain)
    return GaugedBench(
        layout,
        geometry,
        replace(field, torsion_per_nm=torsion),
        sensor,
        data.drive.rated_torque_nm,
    )


def _strain_per_nm(sensor: Sensor) -> float:
    """Return the strain that the bridge takes for 1 N m (equation 4), 1/(N m)."""
    volts = sensor.amplifier_gain * sensor.excitation_v * sensor.gauge_factor
    return 1.0 / (sensor.gain_nm_per_v * volts)


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
    parts = [_effects(bench, _rows(errors, slice(i, i + _CHUNK))) for i in range(0, draws, _CHUNK)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _rows(errors: PlacementErrors, rows: slice) -> PlacementErrors:
    return PlacementErrors(
        errors.radial_mm[rows], errors.circumferential_rad[rows], errors.angular_rad[rows]
    )


def _effects(bench: GaugedBench, errors: PlacementErrors) -> dict[str, FloatArray]:
    beta: FloatArray = np.arange(_POINTS, dtype=np.float64) * (math.pi / _POINTS)

    def shown(torque_nm: float) -> FloatArray:
        strain = grid_strain(
            bench.field,
            bench.layout,
            bench.geometry,
            errors,
            torque_nm=torque_nm,
            wave_angle_rad=beta,
        )
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
