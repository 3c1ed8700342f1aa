"""Density of air and what it does to the force of a weight."""

from __future__ import annotations

import math

__all__ = ["CONVENTIONAL_AIR_KG_M3", "CONVENTIONAL_MASS_KG_M3", "air_density", "buoyancy_factors"]

# conventional mass: balance in air of 1.2 kg/m^3 with weights of 8000 kg/m^3 (OIML D 28, R 111-1)
CONVENTIONAL_AIR_KG_M3 = 1.2
CONVENTIONAL_MASS_KG_M3 = 8000.0


def air_density(pressure_hpa: float, humidity_percent: float, temperature_c: float) -> float:
    """Return the density of moist air.

    Parameters
    ----------
    pressure_hpa : float
        Air pressure, hPa, 600 to 1100.
    humidity_percent : float
        Relative humidity, %, 0 to 100.
    temperature_c : float
        Air temperature, degrees Celsius, 0 to 50.

    Returns
    -------
    float
        Density, kg/m^3; about 2e-4 of it off the full formula near room conditions.

    Raises
    ------
    ValueError
        If a value is out of its domain.

    Notes
    -----
    ``rho = (0.34848 p - 0.009 h exp(0.061 t)) / (273.15 + t)``.

    References
    ----------
    .. [1] OIML R 111-1 (2004), annex E, equation E.3-1.
    """
    if not (
        600.0 <= pressure_hpa <= 1100.0
        and 0.0 <= humidity_percent <= 100.0
        and 0.0 <= temperature_c <= 50.0
    ):
        raise ValueError(
            f"air of {pressure_hpa:g} hPa, {humidity_percent:g} %, {temperature_c:g} deg C; "
            "needed: 600 to 1100 hPa, 0 to 100 %, 0 to 50 deg C"
        )
    vapour = 0.009 * humidity_percent * math.exp(0.061 * temperature_c)
    return (0.34848 * pressure_hpa - vapour) / (273.15 + temperature_c)


def buoyancy_factors(
    air_kg_m3: float, weight_kg_m3: float, *, conventional: bool
) -> tuple[float, float]:
    """Return what turns a stated mass into the mass that presses down in air.

    Parameters
    ----------
    air_kg_m3, weight_kg_m3 : float
        Densities of air and of the weights, kg/m^3.
    conventional : bool
        Whether the conventional mass is stated, as on a certificate, or the true one.

    Returns
    -------
    to_true : float
        True mass over stated mass.
    in_air : float
        Force in air over the force in vacuum of the true mass.

    Notes
    -----
    ``to_true = (1 - rho0/rhoc) / (1 - rho0/rho_m)`` with rho0 = 1.2 kg/m^3, rhoc = 8000 kg/m^3;
    ``in_air = 1 - rho_a / rho_m``.
    """
    stated = 1.0 - CONVENTIONAL_AIR_KG_M3 / CONVENTIONAL_MASS_KG_M3
    own = 1.0 - CONVENTIONAL_AIR_KG_M3 / weight_kg_m3
    return (stated / own if conventional else 1.0), 1.0 - air_kg_m3 / weight_kg_m3
