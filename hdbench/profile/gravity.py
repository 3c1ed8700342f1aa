"""Local gravity from latitude and height."""

from __future__ import annotations

import math
from typing import Literal

GravityFormula = Literal["wgs84", "welmec"]

# WGS 84 defining and derived constants, NIMA TR8350.2 (2000), tables 3.1, 3.3 and 3.4
_EQUATOR_M_S2 = 9.7803253359
_SOMIGLIANA = 0.00193185265241
_ECCENTRICITY_SQUARED = 0.00669437999014
_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_CENTRIFUGAL = 0.00344978650684


def gravity_welmec(latitude_deg: float, altitude_m: float) -> float:
    """Return local gravity by the formula of European legal metrology.

    Notes
    -----
    ``g = 9.780318 (1 + 0.0053024 sin^2 f - 0.0000058 sin^2 2f) - 0.000003085 h``.

    References
    ----------
    .. [1] WELMEC, gravity zones, as printed in the documentation of the package AHRS,
       ahrs.readthedocs.io, function `welmec_gravity`.
    """
    phi = math.radians(latitude_deg)
    normal = 1.0 + 0.0053024 * math.sin(phi) ** 2 - 0.0000058 * math.sin(2.0 * phi) ** 2
    return 9.780318 * normal - 0.000003085 * altitude_m


def gravity_wgs84(latitude_deg: float, altitude_m: float) -> float:
    """Return normal gravity of the WGS 84 ellipsoid (Somigliana), at height.

    Notes
    -----
    ``g0 = g_e (1 + k sin^2 f) / sqrt(1 - e^2 sin^2 f)`` and
    ``g = g0 (1 - (2/a)(1 + fl + m - 2 fl sin^2 f) h + 3 h^2/a^2)``.

    References
    ----------
    .. [1] Department of Defense World Geodetic System 1984, NIMA TR8350.2, third edition, 2000,
       equations 4-1 and 4-3.
    """
    sine = math.sin(math.radians(latitude_deg)) ** 2
    surface = (
        _EQUATOR_M_S2 * (1.0 + _SOMIGLIANA * sine) / math.sqrt(1.0 - _ECCENTRICITY_SQUARED * sine)
    )
    slope = 2.0 / _SEMI_MAJOR_M * (1.0 + _FLATTENING + _CENTRIFUGAL - 2.0 * _FLATTENING * sine)
    return surface * (1.0 - slope * altitude_m + 3.0 * (altitude_m / _SEMI_MAJOR_M) ** 2)


def local_gravity(latitude_deg: float, altitude_m: float, formula: GravityFormula) -> float:
    """Return local gravity by the formula of that name."""
    chosen = gravity_wgs84 if formula == "wgs84" else gravity_welmec
    return chosen(latitude_deg, altitude_m)
