"""From 16-bit words to volts, with the constants that the device carries in its flash."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["FLASH_ADDRESS", "FLASH_WORDS", "InputScale", "nominal_scale", "scale_from_flash"]

# where the calibration stands, and how many 32-bit floats it has per model
FLASH_ADDRESS = 0x3C4000
FLASH_WORDS = {"T7": 41, "T4": 19}
T7_RANGES_V = (10.0, 1.0, 0.1, 0.01)
# high-voltage inputs AIN0 to AIN3 of the T4
_T4_HIGH = 4
# constants may differ from the nominal ones by their tolerance, not by this factor: an erased or
# foreign flash reads otherwise
_SANE = 0.05


@dataclass(frozen=True, slots=True)
class InputScale:
    """Volts of a streamed word.

    Parameters
    ----------
    center : float
        Word at zero volts; below it the negative slope counts.
    positive_v, negative_v : float
        Volts per word above and below the centre; the second is negative.
    source : str
        ``device`` or ``nominal``.

    Notes
    -----
    T7: v = (word - center) positive_v for word >= center, else (center - word) negative_v. A T4's
    v = slope word + offset is the same with center = -offset / slope.
    """

    center: float
    positive_v: float
    negative_v: float
    source: str

    def volts(self, words: NDArray[np.uint16]) -> FloatArray:
        """Return the volts of streamed words."""
        from_center = words.astype(np.float64) - self.center
        slope = np.where(from_center >= 0.0, self.positive_v, -self.negative_v)
        volts: FloatArray = from_center * slope
        return volts


def nominal_scale(model: str, number: int, range_v: float) -> InputScale:
    """Return the scale of an uncalibrated device.

    Notes
    -----
    Nominal constants of LabJack's data sheet, appendix "Internal flash", for the T7's +-10 V range;
    its other ranges are tenths of it.
    """
    if model == "T4":
        slope, offset = (3.235316e-4, -10.532965) if number < _T4_HIGH else (3.826692e-5, 0.002484)
        return InputScale(-offset / slope, slope, -slope, "nominal")
    factor = range_v / 10.0
    return InputScale(33523.0, 3.1580578e-4 * factor, -3.15805800e-4 * factor, "nominal")


def scale_from_flash(
    model: str, words: Sequence[float], number: int, range_v: float
) -> InputScale | None:
    """Return the scale that the device's flash gives; None where that cannot be one.

    Notes
    -----
    T7: 8 groups of positive slope, negative slope, centre, offset: high speed with gain 1, 10, 100,
    1000, then high resolution; streams use the first four. T4: slope and offset of AIN0 to AIN3,
    then of the low-voltage inputs.
    """
    nominal = nominal_scale(model, number, range_v)
    if model == "T4":
        at = 2 * min(number, _T4_HIGH)
        slope, offset = words[at : at + 2]
        if not _near(slope, nominal.positive_v):
            return None
        return InputScale(-offset / slope, slope, -slope, "device")
    at = 4 * T7_RANGES_V.index(range_v)
    positive, negative, center = words[at : at + 3]
    sane = _near(positive, nominal.positive_v) and _near(negative, nominal.negative_v)
    if not (sane and _near(center, nominal.center)):
        return None
    return InputScale(center, positive, negative, "device")


def _near(value: float, nominal: float) -> bool:
    return abs(value - nominal) <= _SANE * abs(nominal)
