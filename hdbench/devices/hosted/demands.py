"""Whether a device can do what is asked of it; told before anything moves."""

from __future__ import annotations

from hdbench.devices.capabilities import Capabilities
from hdbench.devices.hosted.settings import HostSettings
from hdbench.devices.ports import AcquisitionSettings
from hdbench.errors import DeviceError

__all__ = ["check_demands"]

# periods are decimal numbers: a rate equal to the highest one differs by rounding
_ROUNDING = 1.0 + 1e-9


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
