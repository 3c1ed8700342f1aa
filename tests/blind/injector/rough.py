"""Part W: the same effects on a sound record and on one with the nuisances of real logs."""

from dataclasses import dataclass, replace

import numpy as np

from .bench import channels_of, convert, optional
from .build import Made, described, drawn_effect, known_families, scene_of, truth_of
from .family import effect
from .geometry import Whitened, candidates
from .motion import FINE_S, RATIO
from .nuisances import Log, disturbed, draw_nuisances, neutral_names, transients

_STEP_NM = 20.0 / 2**16 * 6.6
_LEAST = 10.0
# sine squared below which two names are one group on a record (contract, section 5)
_GROUP = 0.01


@dataclass(frozen=True)
class _Planned:
    """One hidden effect: its family, shape, size, and its sigmas on both records."""

    name: str
    family: object
    shape: dict
    size: float
    sigmas: tuple


class _Spectral:
    """Whitening of a log's rows by the spectrum of its noise, beside a baseline."""

    def __init__(self, place, power, columns):
        self._place, self._power = place, power
        self._basis = np.linalg.qr(self._white(columns))[0]

    def _white(self, columns):
        columns = columns if columns.ndim == 2 else columns[:, None]
        weight = np.interp(np.fft.rfftfreq(len(columns)), self._place, self._power) ** -0.5
        lines = np.fft.rfft(columns, axis=0) * weight[:, None]
        return np.fft.irfft(lines, len(columns), axis=0)

    def rest(self, columns):
        white = self._white(columns)
        return white - self._basis @ (self._basis.T @ white)


def _measured(scene, log, angle, speed):
    """The scene as somebody sees it who has nothing but the log."""
    path = scene.path
    seen = np.interp(path.time, log.stamps, angle)
    turning = np.interp(path.time, log.stamps, speed)
    # acceleration of a log: its velocity, smoothed over 20 ms
    smooth = np.convolve(np.pad(turning, 10, mode="edge"), np.full(21, 1.0 / 21.0), mode="valid")
    accel = np.gradient(smooth, path.time)
    fine = np.arange(len(path.fine_angle)) * FINE_S
    measured = replace(
        path, angle=seen, speed=turning, accel=accel, output=seen / RATIO,
        fine_angle=np.interp(fine, path.time, seen), fine_speed=np.interp(fine, path.time, turning),
        fine_accel=np.interp(fine, path.time, accel),
    )  # fmt: skip
    return replace(scene, path=measured)


def _plain_sigmas(scene, white, plan, others):
    rests = [white.rest(effect(p.family, scene, p.shape, p.size)) for p in others]
    beside = np.column_stack(rests) if rests else None
    return white.detectability(scene, plan.family, plan.shape, plan.size, beside)


class _Log:
    """A log of one scene: its rows, what its owner sees, and how its noise is whitened."""

    def __init__(self, case, scene, nuisances):
        rng = np.random.default_rng([case.seed, 31])
        self.scene, self.log = scene, Log.of(scene, nuisances, rng)
        self.angle = self.log.angle(scene)
        self.speed = self.log.speed(scene, self.angle, rng)
        self.seen = _measured(scene, self.log, self.angle, self.speed)
        self.floor_nm = max(0.001, 0.02 * scene.noise.sigma_nm)
        time, path = scene.path.time, self.seen.path
        known = [self.seen.baseline()]
        if "gain" in nuisances:
            known += [scene.path.load[:, None], self.seen.tau[:, None]]
        if "inertia" in nuisances:
            known.append(path.accel[:, None])
        columns = np.column_stack(known)
        rows = np.column_stack([np.interp(self.log.stamps, time, column) for column in columns.T])
        rows = rows[:, np.ptp(rows, axis=0) + np.abs(rows[0]) > 0.0]
        self.white = _Spectral(*self.log.spectrum(scene.noise, self.floor_nm), rows)

    def _there(self, plan):
        """The effect as it stands in the log's torque, whitened, beside the baseline."""
        torque = effect(plan.family, self.scene, plan.shape, plan.size)
        rows = self.log.at_instants(
            self.scene.path.time, self.log.filtered(torque), self.log.torque_rows
        )
        return self.white.rest(rows)[:, 0]

    def _caught(self, there, columns):
        """Sigmas of `there` that a form, columns on the channels of the log, catches."""
        time = self.scene.path.time
        rows = [np.interp(self.log.stamps, time, c) for c in self.log.filtered(columns).T]
        basis, sizes, _ = np.linalg.svd(self.white.rest(np.column_stack(rows)), full_matrices=False)
        along = basis[:, sizes > 1e-9 * max(sizes[0], 1e-30)].T @ there
        return float(np.linalg.norm(along))

    def _own(self, plan):
        if plan.family.linear:
            return plan.family.columns(self.seen, plan.shape)
        return effect(plan.family, self.seen, plan.shape, plan.size)[:, None]

    def sigmas(self, plan):
        """Sigmas of the effect that its own form still catches."""
        return self._caught(self._there(plan), self._own(plan))

    def alike(self, plan):
        """Share of what its own form catches, by name, that no form of that name does."""
        there = self._there(plan)
        own = self._caught(there, self._own(plan)) ** 2
        out = {}
        for name, columns in candidates(self.seen, known_families(), plan.shape):
            share = 1.0 - self._caught(there, columns) ** 2 / own
            out[name] = min(out.get(name, 1.0), max(0.0, share))
        if "direction-asymmetry" in out:
            out["side-force"] = out["direction-asymmetry"]
        out[plan.name] = 0.0
        return {name: round(value, 5) for name, value in out.items() if value < 0.25}


def _torque(scene, plans):
    """The sound bench and the effects, N m."""
    effects = (effect(plan.family, scene, plan.shape, plan.size) for plan in plans)
    return scene.clean + sum(effects, np.zeros(len(scene.clean)))


def _planned(case, scene, nuisances):
    """Effects with sizes that both records show: the smaller of both sigmas is the tier's."""
    white = Whitened(scene)
    first = []
    for k in range(len(case.hidden)):
        family, shape = drawn_effect(case, k, scene)
        first.append(_Planned(case.hidden[k].name, family, shape, family.physical[1], ()))
    rough = _Log(case, disturbed(scene, nuisances, _torque(scene, first)), nuisances)
    sound = _Log(case, scene, {})
    out = []
    for plan, hidden in zip(first, case.hidden, strict=True):
        target = float(hidden.tier[1:])

        def both(plan=plan, others=tuple(p for p in first if p.name != plan.name)):
            plain = _plain_sigmas(scene, white, plan, others)
            return plain, plain * rough.sigmas(plan) / max(sound.sigmas(plan), 1e-9)

        sigmas = both()
        # two passes: some forms are no lines in their size
        for _ in range(2):
            factor = target / max(min(sigmas), 1e-6)
            size = min(plan.size * factor, 3.0 * plan.family.physical[2])
            plan = replace(plan, size=size)
            sigmas = both(plan)
        out.append(replace(plan, sigmas=sigmas))
    return out, white


def _truths(plans, scene, white, which, log):
    truths, torques = [], []
    entries = [(plan.family, plan.shape, plan.size) for plan in plans]
    for plan in plans:
        seen = scene.before(plan.family, entries)
        tier = f"d{plan.sigmas[which]:.0f}"
        truth, torque = described(tier, plan.family, seen, plan.shape, plan.size, None, white)
        truth["d"] = plan.sigmas[which]
        if log:
            # what a slow channel blurs is one group there
            truth["alike"] = log.alike(plan)
        truths.append(truth)
        torques.append(torque)
    return truths, torques


def _one_group(truths):
    """Whether one effect is what the name of the other spans on this record."""
    return any(
        one["alike"].get(two["name"], 1.0) < _GROUP for one in truths for two in truths
        if one is not two
    )  # fmt: skip


def _plain_columns(case, scene, torques):
    channels = channels_of(scene, np.random.default_rng([case.seed, 2]))
    for torque in torques:
        channels["torque"] += torque
    # as in the other parts: benches of little noise have an interpolated encoder
    return convert(scene, channels, case.sigma_nm < 0.02)


def _rough_columns(case, made, nuisances, torques):
    scene = made.scene
    log, path = made.log, scene.path
    rng = np.random.default_rng([case.seed, 32])
    noise = scene.noise.draw(len(path.time), np.random.default_rng([case.seed, 2]))
    signal = scene.clean + sum(torques, np.zeros(len(path.time)))
    signal = log.filtered(signal + transients(scene, nuisances, rng))
    torque = log.at_instants(path.time, signal, log.torque_rows) + log.noise(noise)
    torque = torque + made.floor_nm * rng.standard_normal(len(log.instants))[log.torque_rows]
    return {
        "time_s": np.round(log.stamps, 6),
        "motor_velocity_rad_s": made.speed,
        "motor_angle_rad": made.angle,
        "torque_nm": np.round(torque / _STEP_NM) * _STEP_NM,
    }


def build_pair(case):
    """Make one record of a pair; `case.note` is `plain` or `rough`, both of one seed."""
    scene = scene_of(case)
    # a second encoder would see the twist that the nuisances are about
    scene = replace(scene, path=replace(scene.path, second_encoder=False,
                                        output=scene.path.angle / RATIO))  # fmt: skip
    clean = scene.bench.torque(
        scene.path.angle, scene.path.output, scene.path.accel, scene.path.load
    )
    scene = replace(scene, clean=clean)
    nuisances = draw_nuisances(np.random.default_rng([case.seed, 30]))
    plans, white = _planned(case, scene, nuisances) if case.hidden else ([], None)
    names = {plan.name for plan in plans}
    rough = case.note == "rough"
    if rough:
        scene = disturbed(scene, nuisances, _torque(scene, plans))
        white = Whitened(scene) if plans else None
    log = _Log(case, scene, nuisances) if rough else None
    truths, torques = _truths(plans, scene, white, int(rough), log)
    extra = optional(scene, np.random.default_rng([case.seed, 3]), "crosstalk" in names)
    if rough:
        columns = _rough_columns(case, log, nuisances, torques)
        for name, values in extra.items():
            # one logger publishes both torques: what smooths the one smooths the other
            values = log.log.smoothed(values) if name == "load_torque_nm" else values
            columns[name] = log.log.at_instants(scene.path.time, values)
    else:
        columns = {**_plain_columns(case, scene, torques), **extra}
    compared = all(min(plan.sigmas) >= _LEAST for plan in plans) and not _one_group(truths)
    truth = truth_of(
        case, scene.path, truths, pair=case.key.rpartition("-")[0], nuisances=nuisances,
        neutral=neutral_names(nuisances) if rough else [], compared=compared,
    )  # fmt: skip
    return Made(columns, truth, scene, tuple(torques))
