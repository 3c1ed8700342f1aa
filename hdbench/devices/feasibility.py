"""Feasibility: how a bench is run by its profile, and whether its devices can do what is asked."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.devices.bench import AcquisitionSettings
from hdbench.devices.daq import Capabilities, Role
from hdbench.devices.driver import driver_of
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring import OutputChannel
from hdbench.profile.schema import ProfileData

# periods are decimal numbers: a rate equal to the highest one differs by rounding
_ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class HostSettings:
    """How a bench is run from this computer.

    Parameters
    ----------
    profile : ProfileData
        The bench, for its limits and scales.
    roles : tuple of Role
        Channels to sample.
    watchdog_s : float
        Host silence after which the device makes its outputs safe, s.
    output : OutputChannel
        Limit, pace and slew of a reference that the host writes.
    max_skew_s : float
        Largest doubt of the time of a reference that the host writes, on the clock of the samples,
        s; inf where it does not matter.
    """

    profile: ProfileData
    roles: tuple[Role, ...]
    watchdog_s: float
    output: OutputChannel
    max_skew_s: float = math.inf


def host_settings(profile: ProfileData, *, watchdog_s: float | None = None) -> HostSettings:
    """Return the adapter's settings of a profile.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    watchdog_s : float, optional
        Watchdog time in place of the profile's, s.

    Returns
    -------
    HostSettings
    """
    table = profile.daq
    *_, driving = table.part_tables().values()
    found = getattr(driving, "output", None)
    limit_v = profile.limits.reference_v
    return HostSettings(
        profile,
        table.roles,
        table.watchdog_s if watchdog_s is None else watchdog_s,
        found if isinstance(found, OutputChannel) else OutputChannel(limit_v=limit_v),
        getattr(table, "max_skew_s", math.inf),
    )


def check_tables(profile: ProfileData) -> None:
    """Refuse a profile that asks its devices for what they do not have."""
    for table in profile.daq.part_tables().values():
        driver_of(table.driver).verify(table)


def check_drives(profile: ProfileData, what: str) -> None:
    """Refuse a motion where no device of the profile can put out the motor's reference."""
    *_, (name, driving) = profile.daq.part_tables().items()
    if driver_of(driving.driver).drives(driving):
        return
    raise UsageError(
        f"{what} moves the motor; {driving.driver} at {driving.address} has no output in this "
        "profile",
        where=f"key daq.{name}.output" if name else "key daq.output",
        fix='describe the output of the device, or add one that has: driver = "composite"',
    )


def check_pace(profile: ProfileData, sample_period_s: float, what: str) -> None:
    """Refuse a sampling period that the device of the profile cannot keep."""
    table, *_ = profile.daq.part_tables().values()
    rate_hz, limit_hz = 1.0 / sample_period_s, driver_of(table.driver).rate_hz(table)
    if rate_hz <= limit_hz * _ROUNDING or math.isnan(limit_hz):
        return
    raise UsageError(
        f"{what} asks for {rate_hz:.6g} samples/s; {len(table.roles)} channels of "
        f"{table.driver} at {table.address} sustain {limit_hz:.4g}",
        where="key daq.sample_period_s",
        fix=f"sample every {1.0 / limit_hz:.3g} s or more slowly, name fewer daq.channels, or "
        "use a faster line",
    )


def check_demands(asked: AcquisitionSettings, settings: HostSettings, able: Capabilities) -> None:
    """Refuse an acquisition that the device cannot make."""
    missing = [role for role in settings.roles if able.input(role) is None]
    if missing or not settings.roles:
        raise DeviceError(
            f"the device has no channel {', '.join(missing) or 'at all'}; it has "
            f"{', '.join(able.roles) or 'none'}",
            where="key daq.channels",
            fix="name only channels that the device has",
        )
    rate_hz = 1.0 / asked.sample_period_s
    highest_hz = able.max_rate_hz(len(settings.roles))
    if not able.min_rate_hz <= rate_hz * _ROUNDING or not rate_hz <= highest_hz * _ROUNDING:
        raise DeviceError(
            f"{len(settings.roles)} channels at {rate_hz:.6g} Hz; this device and its wire sustain "
            f"{able.min_rate_hz:.4g} to {highest_hz:.4g} Hz",
            where="key daq.sample_period_s",
            fix="sample more slowly, name fewer daq.channels, or use a faster line",
        )
    if asked.reference is not None:
        _check_motion(settings, able)


def _check_motion(settings: HostSettings, able: Capabilities) -> None:
    if not able.drives:
        raise DeviceError(
            "the device has no output for the motor reference",
            where="key daq.driver",
            fix='add one that has: driver = "composite"',
        )
    watchdog = able.watchdog
    if watchdog is None or not able.guarded:
        raise DeviceError(
            "no watchdog of the device that drives the motor would stop it when this computer "
            "falls silent",
            where="key daq.driver",
            fix="drive the motor with a device that has a watchdog",
        )
    if not watchdog.min_s <= settings.watchdog_s <= watchdog.max_s:
        raise DeviceError(
            f"watchdog time {settings.watchdog_s:g} s; the device takes {watchdog.min_s:g} to "
            f"{watchdog.max_s:g} s",
            where="key daq.watchdog_s",
            fix="choose a time that the device takes, as short as the line allows",
        )
    if "tacho" not in settings.roles:
        raise DeviceError(
            "the tacho is not sampled: nobody would see the motor run away",
            where="key daq.channels",
            fix="add tacho",
        )
