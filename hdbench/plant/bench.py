"""Simulated bench: profile, plant and seed to the raw samples of a node."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import UsageError
from hdbench.plant.converter import AnalogueSamples, RawSamples, to_code, to_count
from hdbench.plant.effects import EFFECT_KINDS, encoder_error_rad, start_effect
from hdbench.plant.fixture import GAIN_HARMONICS, Fixture, Mount, PositionGain, shunt_volts
from hdbench.plant.plantfile import PlantSpec, draw_effects
from hdbench.plant.servo import command_rad_s, servo_loop
from hdbench.plant.timeline import AnalogueChannels, Timeline
from hdbench.profile import schema
from hdbench.profile.waves import ReferenceProgram, reference_values
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.model import BenchModel


# One random stream per purpose: what one of them draws does not move another.
_EFFECTS, _GAIN, _CLAMPING, _ACQUISITION = range(4)

# Below this speed the drive is switched off: a quarter of an encoder count of 1.6 mrad per second.
_STANDSTILL_RAD_S = 4e-4

# Time after a halt for which causes of an extended model are computed: ten time constants of a
# velocity loop of 1.6 Hz, slower than any servo.
_BRAKING_S = 1.0


# the emulated bench stands in a room that keeps its temperature
ROOM_C = 20.0


def with_model(profile: schema.ProfileData, model: BenchModel) -> schema.ProfileData:
    """Return `profile` with the baseline of `model`."""
    drive = profile.drive
    turning = drive.flexspline == "turning"
    factor = 1.0 + 1.0 / drive.gear_ratio if turning else 1.0
    ripple = tuple(
        schema.HarmonicParameters(order=order / factor, amplitude_nm=amplitude, phase_rad=phase)
        for order, amplitude, phase in model.ripple
    )
    amplitude, phase = model.misalignment
    misalignment = schema.MisalignmentParameters(amplitude_nm=amplitude, phase_rad=phase)
    baseline = schema.ModelParameters(
        zero_nm=model.zero_nm, ripple=ripple, misalignment=misalignment
    )
    inertia = model.inertia_nm_s2 * drive.gear_ratio
    moved = drive.model_copy(update={"load_inertia_kg_m2": inertia})
    return profile.model_copy(update={"model": baseline, "drive": moved})


def cause_volts(
    model: BenchModel,
    channels: AnalogueChannels,
    mount: Mount,
    sample_period_s: float,
    reference_v: FloatArray,
) -> FloatArray:
    """Return what the causes of `model` add to the torque channel."""
    from hdbench.model import Motion, gauge_order_factor

    profile, ratio = channels.profile, channels.profile.drive.gear_ratio
    command = command_rad_s(profile, reference_v)
    motion = servo_loop(profile.servo).run(command, sample_period_s, 1, (0.0, 0.0, 0.0))
    angle, acceleration = motion.angle_rad[:, 0], motion.acceleration_rad_s2[:, 0]
    time_s = np.arange(len(reference_v), dtype=np.float64) * sample_period_s
    per_volt_a = profile.servo.max_current_a / profile.daq.range_v
    sampled = Motion(
        time_s=time_s,
        velocity_rad_s=motion.velocity_rad_s[:, 0],
        angle_rad=angle,
        acceleration_rad_s2=acceleration,
        output_angle_rad=angle / ratio,
        valid=np.ones(len(reference_v), dtype=bool),
        angle_source="motor_angle_rad",
        gear_ratio=ratio,
        motor_current_a=channels.volts(time_s[:, None], motion, mount)[2, :, 0] * per_volt_a,
        temperature_c=np.full(len(reference_v), ROOM_C),
        gauge_factor=gauge_order_factor(profile.drive),
        inertia_nm_s2=model.inertia_nm_s2,
    )
    return model.cause_torque_nm(sampled) / profile.sensor.gain_nm_per_v


# a weight changes within this time, and samples are at least this far apart
_TICK_S = 1e-6


class ModelCauses:
    """Causes of the model that an emulated bench follows.

    On a locked bench each weight counts with its torque at rest, from the time at which it was
    hung. A new position or direction is a new clamping, at which nothing that remembers is carried
    over.
    """

    def __init__(self, model: BenchModel | None, profile: schema.ProfileData) -> None:
        self.model = model
        self._profile = profile
        self._volts: FloatArray = np.zeros(1)
        # weights that were hung since the lock was closed
        self._held: list[Mount] = []

    @property
    def names(self) -> list[str]:
        """Names of the causes."""
        return [] if self.model is None else [term.name for term in self.model.causes]

    def restart(self, elapsed_s: float) -> None:
        """Count time from a new acquisition, `elapsed_s` after the one before began."""
        self._held = [replace(mount, since_s=mount.since_s - elapsed_s) for mount in self._held]

    def change(self, mount: Mount) -> None:
        """Take note of what is mounted from now on."""
        if not mount.locked:
            self._held = []
            return
        if self._held and (mount.since_s <= self._held[-1].since_s or mount == self._held[-1]):
            self._held.pop()
        self._held.append(mount)

    def move(
        self,
        channels: AnalogueChannels,
        mount: Mount,
        sample_period_s: float,
        reference_v: FloatArray,
    ) -> None:
        """Compute the causes for a whole motion; those of a locked bench come by their time."""
        self._volts = np.zeros(1)
        if self.model is not None and not mount.locked:
            self._volts = cause_volts(self.model, channels, mount, sample_period_s, reference_v)

    def volts(self, stamps: NDArray[np.int64], time_s: FloatArray) -> FloatArray:
        """Return what the causes add at samples."""
        volts: FloatArray = self._volts[np.minimum(stamps, len(self._volts) - 1)]
        if self.model is None or not self._held:
            return volts
        return volts + self._locked_volts(self.model, time_s)

    def _locked_volts(self, model: BenchModel, time_s: FloatArray) -> FloatArray:
        """Return what the causes add at samples of a locked bench."""
        from hdbench.model import Motion

        steps = self._steps()
        now = self._held[-1]
        # samples that were taken before the last weight was hung see it already
        after = np.maximum(time_s, steps[-1][0] + _TICK_S * np.arange(1, len(time_s) + 1))
        time, load, position, starts = (np.array(column) for column in zip(*steps, strict=True))
        still = np.zeros(len(steps) + len(time_s))
        motion = Motion(
            time_s=np.concatenate((time, after)),
            velocity_rad_s=still,
            angle_rad=-_extended(position, now.position_rad, len(after)),
            acceleration_rad_s2=still,
            output_angle_rad=_extended(position, now.position_rad, len(after)),
            valid=np.ones(len(still), dtype=bool),
            angle_source="motor_angle_rad",
            gear_ratio=self._profile.drive.gear_ratio,
            load_torque_nm=_extended(load, now.load.after_nm, len(after)),
            motor_current_a=still,
            temperature_c=np.full(len(still), ROOM_C),
            inertia_nm_s2=model.inertia_nm_s2,
            starts=_extended(starts, 0.0, len(after)) > 0.0,
        )
        torque = model.cause_torque_nm(motion)[len(steps) :]
        return torque / self._profile.sensor.gain_nm_per_v

    def _steps(self) -> list[tuple[float, float, float, float]]:
        """Return time, torque, position and whether it begins anew, for every weight."""
        steps: list[tuple[float, float, float, float]] = []
        before: Mount | None = None
        for mount in self._held:
            anew = before is None or (before.position_rad, before.gain_nm_per_v) != (
                mount.position_rad,
                mount.gain_nm_per_v,
            )
            if before is not None and not anew and mount.since_s - _TICK_S > steps[-1][0]:
                last = before.load.after_nm
                steps.append((mount.since_s - _TICK_S, last, mount.position_rad, 0.0))
            steps.append((mount.since_s, mount.load.after_nm, mount.position_rad, float(anew)))
            before = mount
        return steps


def _extended(values: FloatArray, last: float, count: int) -> FloatArray:
    """Return `values` followed by `count` times `last`."""
    return np.concatenate((values, np.full(count, last)))


class SimulatedBench:
    """Drive, load, sensor and converter behind a node's registers.

    Every acquisition begins with the wave generator and the load standing at their home marks:
    motor angle, output angle and encoder count are 0 at its first sample, and phases refer to it.
    Equations, sources and assumptions stand in ``docs/plant.md``.
    """

    def __init__(
        self,
        profile: schema.ProfileData,
        plant: PlantSpec,
        seed: int,
        *,
        model: BenchModel | None = None,
    ) -> None:
        if not seed >= 0:
            raise UsageError(
                f"seed {seed} is negative; needed: a whole number of at least 0",
                where="--seed",
                fix="give a seed of 0 or more",
            )
        self._profile = profile if model is None else with_model(profile, model)
        self._plant = plant
        self._seed = seed
        self._effects = draw_effects(plant, self._stream(_EFFECTS))
        sensor = profile.sensor
        self._gain = PositionGain.draw(
            sensor.gain_nm_per_v, sensor.gain_consistency, self._stream(_GAIN)
        )
        clamping = partial(self._stream, _CLAMPING)
        self._fixture = Fixture(profile.arm, plant.data.fixture, self._gain, clamping)
        self._channels = AnalogueChannels.build(self._profile, plant.data.motor, self._effects)
        self._acquisitions = 0
        self._noise = self._stream(_ACQUISITION)
        self._timeline: Timeline | None = None
        self._driven = False
        self._shunt_v = 0.0
        self._causes = ModelCauses(model, self._profile)

    @property
    def reference_v(self) -> float:
        """Motor reference that is put out now, V."""
        return 0.0 if self._timeline is None else self._timeline.reference_now_v

    @property
    def velocity_rad_s(self) -> float:
        """True motor speed now, rad/s."""
        return 0.0 if self._timeline is None else self._timeline.state_now[1]

    @property
    def enabled(self) -> bool:
        """Whether the drive is on: from the begin of a driven run to standstill after its halt."""
        if self._timeline is None or not self._driven:
            return False
        return not self._timeline.stopped or abs(self.velocity_rad_s) > _STANDSTILL_RAD_S

    def begin(
        self,
        *,
        sample_period_s: float,
        wave: schema.ReferenceWave | ReferenceProgram | None,
        duration_s: float,
    ) -> None:
        """Begin a new acquisition from standstill at the home marks; both times are above 0 s."""
        self._restart()
        self._driven = wave is not None
        reference_v = reference_values(wave, sample_period_s, duration_s)
        mount = self._fixture.mount
        self._causes.move(self._channels, mount, sample_period_s, reference_v)
        self._timeline = Timeline(self._channels, sample_period_s, reference_v, mount)

    def begin_host_written(
        self,
        *,
        sample_period_s: float,
        start: tuple[float, float] = (0.0, 0.0),
        counted: bool = True,
    ) -> Timeline:
        """Begin a new acquisition whose reference a host writes while it runs."""
        if self._causes.model is not None:
            raise UsageError(
                "an extended model needs the whole motion beforehand; this device's reference is "
                "written by its host as it goes",
                where="--model",
                fix="emulate the profile's own model, or a node",
            )
        self._restart(counted=counted)
        self._driven = False
        self._timeline = Timeline(
            self._channels,
            sample_period_s,
            np.zeros(1),
            self._fixture.mount,
            start=start,
            host_written=True,
        )
        return self._timeline

    def halt(self) -> None:
        """Zero the motor reference now; the drive brakes to standstill within its limits."""
        timeline = self._timeline
        if timeline is None or timeline.stopped:
            return
        timeline.stop()
        braking = round(_BRAKING_S / timeline.sample_period_s)
        until = timeline.now_hold + max(1, braking)
        reference_v = timeline.references(0, until)
        self._causes.move(
            self._channels, self._fixture.mount, timeline.sample_period_s, reference_v
        )

    def advance(self, n_samples: int) -> RawSamples:
        """Return the next samples as the node's converter gives them."""
        true = self.measure(n_samples)
        return RawSamples(
            torque_code=self._code(true.torque_v),
            tacho_code=self._code(true.tacho_v),
            current_code=self._code(true.current_v),
            reference_code=self._code(true.reference_v),
            encoder_count=to_count(true.angle_rad, self._profile.encoder.counts_per_turn),
        )

    def measure(self, n_samples: int) -> AnalogueSamples:
        """Return the next samples in volts, as they stand before a converter."""
        timeline = self._timeline
        if timeline is None or not n_samples >= 0:
            raise UsageError(
                f"{n_samples} samples asked for; needed: an acquisition that was begun, and 0 "
                "samples or more",
                where="simulated bench",
                fix="begin an acquisition first",
            )
        profile, sensor = self._profile, self._profile.sensor
        first = timeline.served
        true = timeline.advance(n_samples)
        white = self._noise.standard_normal((n_samples, 2))
        stamps = np.arange(first, first + n_samples)
        added = self._causes.volts(stamps, timeline.sample_period_s * stamps.astype(np.float64))
        added = added + self._shunt_v
        wander = encoder_error_rad(self._effects, true.angle_rad, profile.drive.gear_ratio)
        noise_v = white[:, 0] * (sensor.noise_nm / sensor.gain_nm_per_v)
        return replace(
            true,
            torque_v=true.torque_v + added + noise_v,
            tacho_v=true.tacho_v + white[:, 1] * profile.tacho.noise_v,
            angle_rad=true.angle_rad + wander,
        )

    def set_fixture(
        self, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> None:
        """Lock or release the wave generator, turn the flexspline, hang a weight."""
        now_s = 0.0 if self._timeline is None else self._timeline.now_s
        mount = self._fixture.change(
            now_s, locked=locked, position_rad=position_rad, mass_kg=mass_kg, direction=direction
        )
        self._causes.change(mount)
        if self._timeline is not None:
            self._timeline.remount(mount)

    def set_handling(self, *, swing_rad: float, release_s: float, shunt_ohm: float) -> None:
        """Set how the next weight is handled, and the resistor across one arm of the bridge."""
        self._fixture.handle(swing_rad=swing_rad, release_s=release_s)
        self._shunt_v = shunt_volts(self._profile, shunt_ohm)

    def truth(self) -> dict[str, object]:
        """Return everything that is simulated, ready for JSON."""
        drive, model, gain = self._profile.drive, self._profile.model, self._gain
        positions = [2.0 * math.pi * k / GAIN_HARMONICS for k in range(GAIN_HARMONICS)]
        factor = 1.0 + 1.0 / drive.gear_ratio if drive.flexspline == "turning" else 1.0
        names = {record: kind for kind, record in EFFECT_KINDS.items()}
        effects = self._channels.effects
        return {
            "plant": self._plant.name,
            "plant_sha256": self._plant.sha256,
            "seed": self._seed,
            "gain_nm_per_v": gain.mean_nm_per_v,
            "gain_spread": gain.spread,
            "gain_at_position": [[position, gain.at(position)] for position in positions],
            "gauges": asdict(self._channels.bridge),
            "zero_nm": model.zero_nm,
            "load_inertia_kg_m2": drive.load_inertia_kg_m2,
            "ripple": [
                {**part.model_dump(), "order": part.order * factor} for part in model.ripple
            ],
            "misalignment": model.misalignment.model_dump(),
            "effects": [{"kind": names[type(effect)], **asdict(effect)} for effect in effects],
            "causes": self._causes.names,
        }

    def _stream(self, *key: int) -> np.random.Generator:
        """Return the random stream of one purpose."""
        return np.random.default_rng([self._seed, *key])

    def _restart(self, *, counted: bool = True) -> None:
        """Count time, noise and effects from a new acquisition."""
        if self._timeline is not None:
            self._fixture.restart(self._timeline.now_s)
            self._causes.restart(self._timeline.now_s)
        self._noise = self._stream(_ACQUISITION, self._acquisitions)
        self._acquisitions += counted
        effects = tuple(start_effect(effect, self._noise) for effect in self._effects)
        self._channels = AnalogueChannels.build(self._profile, self._plant.data.motor, effects)

    def _code(self, volt: FloatArray) -> NDArray[np.int16]:
        """Return codes of a channel."""
        return to_code(volt, self._profile.daq.range_v, self._profile.daq.resolution_bits)
