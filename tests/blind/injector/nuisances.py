"""Nuisances of real logs: what a drive, its logger and the logger's clock do to a record."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, butter, lfilter, sosfilt, sosfiltfilt, welch

from .family import draw_numbers, read_table
from .motion import FINE_S, RATIO, STIFFNESS, turned

_RATE = 1000.0
_RANGE_RAD_S = 562.565
NUISANCES = read_table("nuisances")


def _draw(name, rng):
    entry, flag = NUISANCES[name], bool(rng.random() < 0.5)
    numbers = draw_numbers(entry["draw"], rng)
    return {**numbers, entry["flag"]: flag} if "flag" in entry else numbers


def draw_nuisances(rng):
    """Draw one to four nuisances: name to numbers."""
    names = rng.choice(sorted(NUISANCES), int(rng.integers(1, 5)), replace=False)
    return {str(name): _draw(str(name), rng) for name in sorted(names)}


def neutral_names(nuisances):
    """Names that count neither way beside these nuisances."""
    return sorted({told for name in nuisances for told in NUISANCES[name].get("neutral", ())})


def _second_order(top, hertz, damping):
    pole = 2.0 * np.pi * hertz
    return bilinear(top, [1.0, 2.0 * damping * pole, pole**2], fs=1.0 / FINE_S)


def disturbed(scene, nuisances, torque):
    """The bench with its true inertia, turned by a velocity loop that gives way to `torque`."""
    path, bench = scene.path, scene.bench
    if "inertia" in nuisances:
        bench = replace(bench, inertia=bench.inertia * (1.0 + nuisances["inertia"]["error"]))
    if "speed-ripple" in nuisances:
        drawn = nuisances["speed-ripple"]
        fine_time = np.arange(len(path.fine_speed)) * FINE_S
        over, under = _second_order([1.0, 0.0], drawn["loop_hz"], 0.5)

        def answer(values):
            return -lfilter(over, under, np.interp(fine_time, path.time, values - values[0]))

        # a loop takes hold over some speed: what switches within a millisecond is a blow
        moving = np.clip((np.abs(path.fine_speed) - 1.0) / 20.0, 0.0, 1.0)
        unit = float(np.sqrt(np.mean((moving * answer(scene.clean - path.load)) ** 2)))
        speed = path.fine_speed + drawn["rms_rad_s"] / unit * moving * answer(torque - path.load)
        path = replace(path, **turned(speed, path.load, path.second_encoder))
    clean = bench.torque(path.angle, path.output, path.accel, path.load)
    return replace(scene, path=path, bench=bench, clean=clean)


def transients(scene, nuisances, rng):
    """Decaying oscillations at every start and stop of the shaft, N m."""
    path = scene.path
    out = np.zeros(len(path.time))
    if "transients" not in nuisances:
        return out
    drawn = nuisances["transients"]
    moving = np.abs(path.speed) > 2.0
    for k in np.flatnonzero(np.diff(moving.astype(int))):
        after = path.time[k:] - path.time[k]
        size = drawn["sigmas"] * scene.noise.sigma_nm * rng.uniform(0.6, 1.4)
        wave = np.sin(2.0 * np.pi * drawn["hertz"] * after + rng.uniform(-np.pi, np.pi))
        out[k:] += size * wave * np.exp(-after / drawn["decay_s"])
    return out


@dataclass(frozen=True)
class Log:
    """One logger: true instants, stamps and rows of its samples, and the torque's filter."""

    nuisances: dict
    instants: np.ndarray
    stamps: np.ndarray
    rows: np.ndarray
    torque_rows: np.ndarray
    step: int

    @classmethod
    def of(cls, scene, nuisances, rng):
        """Draw the instants, held samples and gaps of one record."""
        step = round(_RATE / nuisances["rate"]["hertz"]) if "rate" in nuisances else 1
        even = scene.path.time[::step]
        instants, stamps = even, even.copy()
        if "false-stamps" in nuisances:
            jitter = nuisances["false-stamps"]["jitter"]
            gaps = np.exp(jitter * rng.standard_normal(len(even) - 1))
            instants = np.concatenate([[0.0], np.cumsum(gaps) / gaps.sum()]) * even[-1]
        rows = torque_rows = np.arange(len(even))
        if "held" in nuisances:
            fresh = rng.random(len(even)) >= nuisances["held"]["share"]
            fresh[0] = True
            torque_rows = np.maximum.accumulate(np.where(fresh, rows, 0))
            if not nuisances["held"]["torque_only"]:
                rows = torque_rows
        if "gaps" in nuisances:
            keep = np.ones(len(even), dtype=bool)
            for _ in range(nuisances["gaps"]["count"]):
                start = rng.uniform(0.05, 0.95) * even[-1]
                keep[(even >= start) & (even < start + rng.uniform(0.002, 0.03))] = False
            rows, torque_rows = rows[keep], torque_rows[keep]
            stamps = stamps[keep] if nuisances["gaps"]["stamped"] else stamps[: len(rows)]
        return cls(nuisances, instants, stamps, rows, torque_rows, step)

    def filtered(self, values):
        """Torque `values` (n,) or (n, k) at 1 kHz behind the filters, with the wrong gain."""
        return (1.0 + self.nuisances.get("gain", {}).get("error", 0.0)) * self.smoothed(values)

    def smoothed(self, values):
        """`values` (n,) or (n, k) at 1 kHz behind the filters."""
        out = values
        low = self.nuisances.get("low-pass")
        if low:
            sos = butter(2, low["hertz"], fs=_RATE, output="sos")
            if low["causal"]:
                first = out[:1]
                out = first + sosfilt(sos, out - first, axis=0)
            else:
                out = sosfiltfilt(sos, out, axis=0)
        rate = self.nuisances.get("rate")
        if rate and rate["anti_alias"]:
            sos = butter(4, 0.4 * rate["hertz"], fs=_RATE, output="sos")
            out = sosfiltfilt(sos, out, axis=0)
        return out

    def at_instants(self, time, values, rows=None):
        """Sample `values` at the true instants of the rows."""
        rows = self.rows if rows is None else rows
        return _interpolated(self.instants[rows], time, values)

    def noise(self, noise):
        """Noise of the rows: each sample has its own, whatever its instant."""
        return self.filtered(noise)[:: self.step][self.torque_rows]

    def spectrum(self, noise, floor_nm):
        """(frequency per sample, power) of the noise that a row of the torque has."""
        long = self.filtered(noise.draw(2**18, np.random.default_rng(1)))[:: self.step]
        place, power = welch(long, nperseg=512, detrend=False)
        return place, 0.5 * power + floor_nm**2

    def angle(self, scene):
        """Motor angle as it is measured, rad."""
        path = scene.path
        drawn = self.nuisances.get("output-encoder")
        if not drawn:
            width = 2.0 * np.pi / (2**16 if scene.noise.sigma_nm < 0.02 else 4000)
            return np.floor(self.at_instants(path.time, path.angle) / width) * width
        one, two, motor = drawn["phases"]
        error = drawn["error_rad"] * (
            0.7 * np.cos(path.angle / RATIO + one)
            + 0.25 * np.cos(2.0 * path.angle / RATIO + two)
            + 0.05 * np.cos(path.angle + motor)
        )
        output = path.angle / RATIO - path.load / STIFFNESS + error
        width = 2.0 * np.pi / 2**20
        return RATIO * np.floor(self.at_instants(path.time, output) / width) * width

    def speed(self, scene, angle, rng):
        """Motor speed as the log has it, rad/s."""
        drawn, path = self.nuisances.get("velocity"), scene.path
        if not drawn:
            tacho = self.at_instants(path.time, path.speed)
            own = 0.05 * rng.standard_normal(len(self.instants))
            return np.round(tacho + own[self.rows], 2)
        if drawn["differences"]:
            return np.gradient(angle, self.stamps)
        # two equal poles whose delays add up
        pole = np.exp(-2.0 / (_RATE * drawn["delay_s"]))
        slow = path.speed
        for _ in range(2):
            slow = lfilter([1.0 - pole], [1.0, -pole], slow, zi=[slow[0] * pole])[0]
        width = 2.0 * _RANGE_RAD_S / 2**12
        return np.round(self.at_instants(path.time, slow) / width) * width


def _interpolated(places, time, values):
    # straight lines would take from a ripple what grows with the square of its frequency
    return CubicSpline(time, values, axis=0)(places)
