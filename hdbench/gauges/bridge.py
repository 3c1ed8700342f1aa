"""The Wheatstone bridge, exactly: from strain to the voltage that the DAQ sees."""

from __future__ import annotations

import numpy as np

from hdbench.profile.schema import Sensor
from hdbench.records.trace import FloatArray


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
