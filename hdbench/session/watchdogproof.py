"""Proof of a watchdog: the motor turns, the host falls silent, the device must stop it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from hdbench.devices import open_bench
from hdbench.devices.bench import AcquisitionSettings, SafeState, scaled
from hdbench.devices.daq import Daq
from hdbench.devices.host.bench import HostedBench
from hdbench.devices.safestate import STANDSTILL_RAD_S
from hdbench.errors import HdbenchError, UnsafeError, UsageError
from hdbench.profile import Profile
from hdbench.profile.schema import ProfileData, ReferenceWave
from hdbench.session.limits import LimitWatch
from hdbench.session.runner import next_block
from hdbench.session.stop import StopSignals

# a fiftieth of the fastest motion, at least ten times what counts as standing
_SHARE = 0.02
_LEAST_RAD_S = 5.0
_CREEP_S = 0.5
_LONGEST_S = 60.0
# after the watchdog's own time: braking from a creep, and the clocks of either side
_BRAKING_S = 0.7
# between two readings of an encoder
_APART_S = 0.1


@dataclass(frozen=True, slots=True)
class WatchdogProof:
    """What was seen."""

    proven: bool
    detail: str
    creep_rad_s: float | None
    watchdog_s: float
    silence_s: float
    after_rad_s: float | None
    safe: SafeState


def creep_rad_s(profile: ProfileData) -> float:
    """Return the speed at which the watchdog of a bench is proven, rad/s."""
    limit = profile.limits.velocity_rad_s
    return min(max(_SHARE * limit, _LEAST_RAD_S), limit)


def prove_watchdog(
    profile: Profile,
    stop: StopSignals,
    *,
    address: str | None = None,
) -> WatchdogProof:
    """Turn the motor slowly, say nothing more, and see whether the device stops it.

    For the length of the proof the guard process is told to wait: it would stop the motor first.
    It still does when this process ends.
    """
    data = profile.data
    with open_bench(profile, address=address, realtime=True) as bench:
        able = bench.capabilities()
        if not (able.drives and able.guarded and able.watchdog is not None):
            raise UsageError(
                "this device has no watchdog that stops the motor",
                where=f"[daq] of profile {data.name}",
                fix="use a device that has one for everything that moves",
            )
        try:
            creep = _creep(data, bench, stop)
            watchdog_s = bench.daq.watchdog().time_s
            _be_silent(bench, watchdog_s + _BRAKING_S, stop)
            tripped, after, failed = False, None, ""
            try:
                tripped = bench.daq.watchdog().tripped
                after = _speed(bench.daq, data)
            except HdbenchError as error:
                tripped, failed = False, error.what
        finally:
            safe = bench.safe_state()
            if not safe.confirmed:
                raise UnsafeError.unconfirmed(safe.detail, where=address or data.daq.address)
    return _judged(creep, watchdog_s, (tripped, after, failed), safe)


def _creep(data: ProfileData, bench: HostedBench, stop: StopSignals) -> float:
    """Turn the motor and return its speed after half a second, rad/s."""
    level_v = creep_rad_s(data) / data.servo.velocity_gain_rad_s_per_v
    period_s = data.daq.sample_period_s
    wave = ReferenceWave(wave="constant", amplitude_v=level_v)
    n_samples = math.ceil(min(_LONGEST_S, data.limits.duration_s) / period_s)
    bench.configure(AcquisitionSettings(period_s, n_samples, wave))
    limits = LimitWatch(data.limits)
    bench.start()
    seen, last = 0, 0.0
    while seen * period_s < _CREEP_S:
        block = next_block(bench, stop)
        seen = block.first_index + len(block)
        if len(block):
            rows = scaled(block, data, data.sensor.gain_nm_per_v)
            limits.check(block, rows)
            last = float(np.mean(rows["motor_velocity_rad_s"][block.lost_before :]))
    return last


def _be_silent(bench: HostedBench, silence_s: float, stop: StopSignals) -> None:
    if bench.guard is not None:
        bench.guard.watch("end-only")
    bench.fall_silent()
    until_s = time.monotonic() + silence_s
    while time.monotonic() < until_s:
        stop.check()
        time.sleep(0.02)


def _speed(daq: Daq, data: ProfileData) -> float | None:
    """Return the motor's speed at this moment, rad/s; None where it is not measured."""
    first = daq.snapshot()
    if not first:
        # a stream has the inputs; to end it stops no motor
        daq.stop()
        first = daq.snapshot()
    if "tacho" in first:
        return first["tacho"] * data.tacho.gain_rad_s_per_v
    start_s = time.monotonic()
    time.sleep(_APART_S)
    second = daq.snapshot()
    if not ("encoder" in first and "encoder" in second):
        return None
    turn = 2.0 * math.pi / data.encoder.counts_per_turn
    return (second["encoder"] - first["encoder"]) * turn / (time.monotonic() - start_s)


def _judged(
    creep: float,
    watchdog_s: float,
    found: tuple[bool, float | None, str],
    safe: SafeState,
) -> WatchdogProof:
    tripped, after, failed = found
    silence_s = watchdog_s + _BRAKING_S
    turned = abs(creep) > 2.0 * STANDSTILL_RAD_S
    stands = after is not None and abs(after) < STANDSTILL_RAD_S
    if failed:
        detail = f"after {silence_s:.2f} s of silence the device does not answer: {failed}"
    elif not turned:
        detail = f"the motor did not turn ({creep:.3g} rad/s); nothing is proven"
    elif after is None:
        detail = "this bench measures no motor speed: look whether the motor stood"
    elif not stands:
        detail = f"THE MOTOR STILL TURNED AT {after:.4g} rad/s after {silence_s:.2f} s of silence"
    elif not tripped:
        detail = f"the motor stands ({after:.3g} rad/s), but the watchdog says it has not acted"
    else:
        detail = (
            f"{creep:.3g} rad/s, then {silence_s:.2f} s of silence: the watchdog "
            f"({watchdog_s:g} s) stopped the motor ({after:.2g} rad/s)"
        )
    proven = turned and stands and tripped and safe.confirmed
    return WatchdogProof(
        proven, detail, creep if turned else None, watchdog_s, silence_s, after, safe
    )
