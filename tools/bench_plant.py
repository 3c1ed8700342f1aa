"""Print how much faster than real time the simulated bench runs, on one core.

Usage: python tools/bench_plant.py [--seconds S]
"""

from __future__ import annotations

import argparse
import time

from hdbench.devices.node.registers import ALL_CHANNELS, block_scans
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile import load_profile

_BLOCK_SCANS = block_scans(ALL_CHANNELS.bit_count())


def ratio(plant: str, *, block: int, seconds: float, locked: bool) -> float:
    """Return simulated time over elapsed time."""
    profile = load_profile("cim-tr-97-06").data
    bench = SimulatedBench(profile, load_plant(plant), 1)
    bench.set_fixture(locked=locked, position_rad=0.0, mass_kg=4.0, direction=1)
    period_s = profile.calibration.sample_period_s if locked else profile.daq.sample_period_s
    wave = None if locked else profile.ripple.reference
    n_samples = round(seconds / period_s)
    started = time.perf_counter()
    bench.begin(sample_period_s=period_s, wave=wave, duration_s=seconds)
    for _ in range(0, n_samples, block):
        bench.advance(block)
    return seconds / (time.perf_counter() - started)


def main() -> None:
    """Print one line per case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="time to simulate, s")
    seconds = parser.parse_args().seconds
    for plant in ("as-modelled", "worn"):
        # a sample, a block of the wire, which is what a host asks for while it watches, a second
        for block in (1, _BLOCK_SCANS, 1000):
            free = ratio(plant, block=block, seconds=seconds, locked=False)
            print(f"{plant:12} 1 kHz, 5 channels, {block:4} at once: {free:6.0f} x real time")
        locked = ratio(plant, block=_BLOCK_SCANS, seconds=seconds, locked=True)
        print(f"{plant:12} locked, 100 Hz,     {_BLOCK_SCANS:4} at once: {locked:6.0f} x real time")


if __name__ == "__main__":
    main()
