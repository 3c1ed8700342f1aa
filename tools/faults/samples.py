"""Faults of the samples: channels that are stuck, saturated, far off or no number."""

from __future__ import annotations

import dataclasses
import math
import random
from pathlib import Path

import numpy as np

from faults.kit import Row
from hdbench.devices.bench import Block
from hdbench.errors import DeviceError
from hdbench.filter import preset
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile import load_profile
from hdbench.session.limits import LimitWatch, SpeedWatch
from hdbench.session.recorder import TraceRecorder
from hdbench.session.stop import Aborted

__all__ = ["broken_channels"]

PERIOD_S, BLOCK, RUN = 1e-3, 22, 3000
PROFILE = load_profile("cim-tr-97-06").data
KINDS = ("tacho stuck", "encoder stuck", "torque stuck", "torque saturated", "tacho no number",
         "tacho spike")  # fmt: skip
# A stuck channel is to be found 0.2 s (and the block in which they end) after it has begun to tell
# a speed that is off by a quarter: while the motor happens to keep that speed nothing is wrong.
FOUND_SAMPLES, WINDOW = 200 + BLOCK, 100
OFF_SHARE = 0.25
RANGE_RAD_S = PROFILE.daq.range_v * PROFILE.tacho.gain_rad_s_per_v
# one clean run of this length beside every so many trials
CLEAN_EVERY, CLEAN_SAMPLES = 20, 60_000


class Nowhere:
    """A journal that keeps nothing."""

    def append(self, *_: object, **__: object) -> None:
        """Keep nothing."""


def _bench(seed: int, n: int) -> SimulatedBench:
    bench = SimulatedBench(PROFILE, load_plant("as-modelled"), seed)
    wave = PROFILE.ripple.reference.model_copy(update={"amplitude_v": 0.9, "frequency_hz": 0.5})
    bench.begin(sample_period_s=PERIOD_S, wave=wave, duration_s=n * PERIOD_S)
    return bench


def _block(bench: SimulatedBench, first: int, n: int) -> Block:
    raw = bench.advance(n)
    volts = PROFILE.daq.range_v / 32768.0
    return Block(
        first, 0, raw.torque_code * volts, raw.tacho_code * volts,
        raw.current_code * PROFILE.servo.max_current_a / 32768.0, raw.reference_code * volts,
        np.asarray(raw.encoder_count, dtype=np.int64), np.abs(raw.torque_code.astype(int)) >= 32767,
        running=True, watchdog_tripped=False, depth=0,
    )  # fmt: skip


def _spoilt(block: Block, kind: str, start: int, held: dict[str, float]) -> Block:
    """Return the block with its channel broken from sample `start` on."""
    since = np.arange(block.first_index, block.first_index + len(block)) >= start
    if not since.any():
        held["tacho"], held["torque"] = float(block.tacho_v[-1]), float(block.torque_v[-1])
        held["encoder"] = float(block.encoder_count[-1])
        return block
    if kind == "tacho stuck":
        return dataclasses.replace(block, tacho_v=np.where(since, held["tacho"], block.tacho_v))
    if kind == "encoder stuck":
        counts = np.where(since, int(held["encoder"]), block.encoder_count)
        return dataclasses.replace(block, encoder_count=counts)
    if kind == "torque stuck":
        return dataclasses.replace(block, torque_v=np.where(since, held["torque"], block.torque_v))
    if kind == "torque saturated":
        return dataclasses.replace(block, saturated=block.saturated | since)
    value = math.nan if kind == "tacho no number" else 9.9
    once = since & (np.arange(block.first_index, block.first_index + len(block)) == start)
    return dataclasses.replace(block, tacho_v=np.where(once, value, block.tacho_v))


def _due(seed: int, n: int, kind: str, start: int) -> int:
    """Return from which sample on the stuck channel is off; `n` where it never is."""
    bench = _bench(seed, n)
    whole = np.concatenate([_block(bench, first, min(BLOCK, n - first)).tacho_v
                            for first in range(0, n, BLOCK)])  # fmt: skip
    speed = np.convolve(whole * PROFILE.tacho.gain_rad_s_per_v, np.ones(WINDOW) / WINDOW, "valid")
    held = speed[start - start % BLOCK - 1] if kind == "tacho stuck" else 0.0
    away = np.abs(speed - held) > np.maximum(
        0.01 * RANGE_RAD_S, OFF_SHARE * np.maximum(np.abs(speed), abs(held))
    )
    off = np.flatnonzero(away[start:])
    return start + int(off[0]) if len(off) else n


def _run(seed: int, n: int, kind: str, start: int) -> tuple[str, int, TraceRecorder]:
    """Walk a run as the session does; return what ended it, after which sample, and the counts."""
    bench, held = _bench(seed, n), {}
    recorder = TraceRecorder(PROFILE, 6.6, preset("report-6", PROFILE), Nowhere(), PERIOD_S)
    recorder.begin(None)
    limits, speed = LimitWatch(PROFILE.limits), SpeedWatch(PERIOD_S, RANGE_RAD_S)
    for first in range(0, n, BLOCK):
        block = _block(bench, first, min(BLOCK, n - first))
        if kind:
            block = _spoilt(block, kind, start, held)
        try:
            rows = recorder.add(block)
            limits.check(block, rows)
            speed.check(block, rows)
        except (DeviceError, Aborted) as error:
            return type(error).__name__, first + len(block), recorder
    return "", n, recorder


def broken_channels(_folder: Path, trials: int, seed: int) -> Row:
    """Break a channel at any moment of a motion; and look at runs in which nothing is broken."""
    row = Row("19", "tacho, encoder or torque stuck, saturated, no number, far off, at any moment")
    chance, clean = random.Random(seed), 0
    for number in range(trials):
        kind, start = KINDS[number % len(KINDS)], chance.randint(50, RUN - 800)
        ended, after, recorder = _run(seed + number, RUN, kind, start)
        if kind in ("tacho stuck", "encoder stuck"):
            due = _due(seed + number, RUN, kind, start)
            found = ended == "DeviceError" and after - due <= FOUND_SAMPLES
            never = not ended and due > RUN - FOUND_SAMPLES
            problem = "" if found or never else f"{kind}: {ended} {after}, {due} {start}"
        elif kind.startswith("torque"):
            marked = recorder.counts["held" if kind == "torque stuck" else "saturated"]
            # the sample before the fault holds the same value
            exact = RUN - start <= marked <= RUN - start + BLOCK
            problem = "" if not ended and exact else f"{kind}: {ended} {marked} of {RUN - start}"
        else:
            soon = after - start <= BLOCK
            problem = "" if ended == "Aborted" and soon else f"{kind}: {ended} {after - start}"
        row.add(problem)
        if number % CLEAN_EVERY == 0:
            ended, _, recorder = _run(seed + number, CLEAN_SAMPLES, "", 0)
            clean += CLEAN_SAMPLES
            held = recorder.counts["held"]
            if ended or held:
                row.bad.append(f"a clean run: {ended} {held}")
                row.good -= 1
    row.notes["minutes of clean motion, no false alarm"] = round(clean * PERIOD_S / 60.0, 1)
    row.notes["a speed off by a quarter is found within s"] = FOUND_SAMPLES * PERIOD_S
    return row
