"""Gauged bench: strain under every grid, and the Wheatstone bridge that turns it into volts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.gauges.layout import GridGeometry, Layout
from hdbench.profile.schema import ProfileData, Sensor
from hdbench.records.trace import FloatArray


@dataclass(frozen=True, slots=True)
class Wave:
    r"""What the wave generator's ellipse does to the diaphragm at one order."""

    # cycles per turn of the wave generator against the flexspline
    order: float
    # :math:`\Psi_m`, strain amplitude of the difference of a rosette's two grids (equation 2)
    pair_strain: float


@dataclass(frozen=True, slots=True)
class StrainField:
    """Surface strain of the diaphragm about the mean radius of the rosettes."""

    # strain of one grid at 45 degrees at the mean radius for 1 N m, 1/(N m), above 0
    torsion_per_nm: float
    # orders of the wave generator's strain
    waves: tuple[Wave, ...]
    # amplitude of radial less tangential wave strain, and of their sum, over that of the shear, at
    # least 0
    normal_share: float = 1.0
    # steady radial strain from assembly at the mean radius; its tangential strain is 0
    assembly_strain: float = 0.0
    # exponent with which wave and assembly strain grow with the radius, at least 0
    radial_growth: float = 1.0


@dataclass(frozen=True, slots=True)
class PlacementErrors:
    """How far each rosette is from its place."""

    # shape (draws, rosettes): Outwards, mm
    radial_mm: FloatArray
    # shape (draws, rosettes): Along the circumference, angle on the diaphragm, rad, counter-
    # clockwise
    circumferential_rad: FloatArray
    # shape (draws, rosettes): Turned about its own centre, rad, counter-clockwise
    angular_rad: FloatArray

    def __post_init__(self) -> None:
        shapes = {self.radial_mm.shape, self.circumferential_rad.shape, self.angular_rad.shape}
        if len(shapes) != 1 or self.radial_mm.ndim != 2:
            raise ValueError(f"shapes {shapes}; needed: one shape (draws, rosettes)")

    @classmethod
    def none(cls, draws: int, rosettes: int) -> PlacementErrors:
        """Return rosettes that are all in place.

        Parameters
        ----------
        draws, rosettes : int
            Shape.

        Returns
        -------
        PlacementErrors
        """
        zero = np.zeros((draws, rosettes))
        return cls(zero, zero, zero)

    def part(self, rows: slice) -> PlacementErrors:
        """Return some of the draws."""
        return PlacementErrors(
            self.radial_mm[rows], self.circumferential_rad[rows], self.angular_rad[rows]
        )


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


def _strain_per_nm(sensor: Sensor) -> float:
    """Return the strain that the bridge takes for 1 N m (equation 4), 1/(N m)."""
    volts = sensor.amplifier_gain * sensor.excitation_v * sensor.gauge_factor
    return 1.0 / (sensor.gain_nm_per_v * volts)


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


def grid_strain(
    bench: GaugedBench, errors: PlacementErrors, *, torque_nm: float, wave_angle_rad: FloatArray
) -> FloatArray:
    r"""Return the strain along every grid.

    Parameters
    ----------
    bench : GaugedBench
        The strain of the diaphragm, where rosettes should be and where their grids are.
    errors : PlacementErrors
        How far the rosettes are off.
    torque_nm : float
        Torque, N m.
    wave_angle_rad : ndarray, shape (angles,)
        Angle beta of the wave generator's major axis against the flexspline, rad.

    Returns
    -------
    ndarray, shape (draws, angles, rosettes, 2)
        Strain of the odd and of the even grid, small-strain theory.

    Notes
    -----
    A grid whose centre is at radius r and angle :math:`\varphi`, at :math:`\alpha` to the radius,
    has :math:`\varepsilon = \varepsilon_m + \varepsilon_d \cos 2\alpha + \frac{\gamma}{2} \sin
    2\alpha` (plane strain transformation). Torsion of an annulus gives :math:`\gamma / 2 =
    \varepsilon_t T (r_0/r)^2`; the wave :math:`\gamma / 2 = \frac{1}{2} \Psi_m (r/r_0)^q \sin
    m(\beta - \varphi)`, so that two grids at :math:`\pm 45` degrees differ by :math:`2
    \varepsilon_t T + \Psi_m \sin m \beta`: equation 2 of CIM-TR-97-06. Its normal strains
    :math:`\varepsilon_m, \varepsilon_d` have the amplitude :math:`\frac{1}{2} \Psi_m` times
    `normal_share` and go with the cosine, as those of an ovalised ring do.
    """
    field, middle_mm = bench.field, bench.geometry.radius_mm
    radius, angle, direction = _grid_places(bench.layout, bench.geometry, errors)
    growth = (radius / middle_mm) ** field.radial_growth
    steady = 0.5 * field.assembly_strain * growth[:, None]
    shear = np.broadcast_to(
        (field.torsion_per_nm * torque_nm * (middle_mm / radius) ** 2)[:, None],
        (len(radius), len(wave_angle_rad), *radius.shape[1:]),
    )
    normal = np.broadcast_to(steady, shear.shape)
    for wave in field.waves:
        phase = wave.order * (wave_angle_rad[None, :, None, None] - angle[:, None])
        size = 0.5 * wave.pair_strain * growth[:, None]
        shear = shear + size * np.sin(phase)
        normal = normal + field.normal_share * size * np.cos(phase)
    cosine, sine = np.cos(2.0 * direction)[:, None], np.sin(2.0 * direction)[:, None]
    return np.asarray(normal * (1.0 + cosine) + shear * sine)


def _grid_places(
    layout: Layout, geometry: GridGeometry, errors: PlacementErrors
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return radius (mm), angle and direction against the radius (rad) of every grid."""
    # the odd grid is the inner one unless the rosette is reversed
    inner = np.array([[1.0, -1.0] if r.reverse else [-1.0, 1.0] for r in layout.rosettes])
    turn = errors.angular_rad[..., None]
    along = 0.5 * geometry.spacing_mm * inner * np.cos(turn)
    across = 0.5 * geometry.spacing_mm * inner * np.sin(turn)
    outwards = geometry.radius_mm + errors.radial_mm[..., None] + along
    beside = np.arctan2(across, outwards)
    centre = np.array(layout.angles_rad)[:, None] + errors.circumferential_rad[..., None]
    nominal = np.array([math.pi / 4.0, -math.pi / 4.0])
    return np.hypot(outwards, across), centre + beside, nominal + turn - beside


def off_centre(
    layout: Layout, geometry: GridGeometry, shift_mm: FloatArray, towards_rad: FloatArray
) -> PlacementErrors:
    """Return the errors of rosettes that stay in place on a film that was shifted.

    Parameters
    ----------
    layout : Layout
        The rosettes.
    geometry : GridGeometry
        Their radius.
    shift_mm : ndarray, shape (draws,)
        How far the film's middle is off the axis, mm; less than the radius.
    towards_rad : ndarray, shape (draws,)
        In which direction, rad, counter-clockwise from the index mark.

    Returns
    -------
    PlacementErrors
        Radius and angle of every rosette about the true axis. A shift does not turn the rosettes:
        each turns against its own radius by as much as its angle changes, the other way.

    Notes
    -----
    To first order rosettes opposite each other change their angle by opposite amounts, and the
    bridge adds them: four rosettes at right angles take it away, two do not.
    """
    angles = np.array(layout.angles_rad)
    x = geometry.radius_mm * np.cos(angles) + (shift_mm * np.cos(towards_rad))[:, None]
    y = geometry.radius_mm * np.sin(angles) + (shift_mm * np.sin(towards_rad))[:, None]
    along = np.arctan2(y, x) - angles
    along = np.arctan2(np.sin(along), np.cos(along))
    return PlacementErrors(np.hypot(x, y) - geometry.radius_mm, along, -along)


def bridge_ratio(strain: FloatArray, gauge_factor: float) -> FloatArray:
    r"""Return output over supply of the bridge.

    Parameters
    ----------
    strain : ndarray, shape (..., rosettes, 2)
        Strain of odd and even gauge of every rosette; an even number of rosettes.
    gauge_factor : float
        Relative change of resistance per strain, K.

    Returns
    -------
    ndarray, shape (...,)
        Output voltage over supply voltage.

    Raises
    ------
    ValueError
        If the number of rosettes is odd: then a bridge arm would be empty.

    Notes
    -----
    :math:`\frac{E_{out}}{E_{sup}} = \frac{R_1 R_3 - R_2 R_4}{(R_1 + R_2)(R_3 + R_4)}`, gauges of
    one arm in series, :math:`R = R_0 (1 + K \varepsilon)`; constant supply voltage, no lead
    resistance, no load on the output. For small strain :math:`\frac{K}{4} (\varepsilon_1 -
    \varepsilon_2 + \varepsilon_3 - \varepsilon_4)`, equation 4 of CIM-TR-97-06.
    """
    if strain.shape[-2] % 2:
        raise ValueError(f"{strain.shape[-2]} rosettes; needed: an even number")
    resistance = 1.0 + gauge_factor * strain
    first, second = resistance[..., 0::2, :].sum(axis=-2), resistance[..., 1::2, :].sum(axis=-2)
    arm_1, arm_2 = first[..., 0], first[..., 1]
    arm_3, arm_4 = second[..., 0], second[..., 1]
    return np.asarray((arm_1 * arm_3 - arm_2 * arm_4) / ((arm_1 + arm_2) * (arm_3 + arm_4)))


def torque_reading(strain: FloatArray, sensor: Sensor) -> FloatArray:
    """Return the torque that the bench shows for the strain of its gauges.

    Parameters
    ----------
    strain : ndarray, shape (..., rosettes, 2)
        Strain of odd and even gauge of every rosette.
    sensor : Sensor
        Gauge factor, supply, amplifier and gain of the profile.

    Returns
    -------
    ndarray, shape (...,)
        Gain times amplified bridge voltage, N m.
    """
    volts = sensor.amplifier_gain * sensor.excitation_v * bridge_ratio(strain, sensor.gauge_factor)
    return np.asarray(sensor.gain_nm_per_v * volts)
