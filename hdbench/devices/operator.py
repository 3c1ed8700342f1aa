"""Operator of a simulated bench: sets the fixture as the prompts ask, with chosen mistakes."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from typing import Literal, cast

import numpy as np

from hdbench.devices.bench import AcquisitionSettings, Bench
from hdbench.devices.wire.address import dial, numbered, parse_address
from hdbench.errors import DeviceError, UsageError
from hdbench.profile import Profile

_DEADLINE_S = 5.0
_LONGEST = 4096


class Simulation:
    """Sets what a person would set at a bench.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT`` of the channel, as the emulator gives it.
    embedded : bool
        Whether this process started the emulator: only then its motor may move unasked.

    Raises
    ------
    DeviceError
        If nobody answers there, or no emulator.
    UsageError
        If the address has another form.
    """

    def __init__(self, address: str, *, embedded: bool) -> None:
        self.embedded = embedded
        self._address = address
        found = parse_address(numbered(address))
        try:
            self._socket = dial((found.host, found.port), _DEADLINE_S)
        except OSError as error:
            raise self._error(f"no connection ({error.strerror or error})") from error
        try:
            self.set()
        except DeviceError:
            self.close()
            raise

    def close(self) -> None:
        """Close the channel."""
        self._socket.close()

    def set(self, **order: Mapping[str, float]) -> None:
        """Set ``fixture`` (lock, position, weight) or ``handling`` (of the next weight, shunt)."""
        until_s = time.monotonic() + _DEADLINE_S
        line = b""
        try:
            self._socket.sendall(json.dumps(order).encode() + b"\n")
            while not line.endswith(b"\n") and len(line) < _LONGEST:
                self._socket.settimeout(max(1e-3, until_s - time.monotonic()))
                chunk = self._socket.recv(_LONGEST)
                if not chunk:
                    break
                line += chunk
            answer = json.loads(line)
        except OSError as error:
            raise self._error(f"no answer ({error.strerror or error})") from error
        except (ValueError, RecursionError) as error:
            raise self._error("this is no emulator's control channel") from error
        if answer != {"ok": True}:
            refused = answer.get("refused") if isinstance(answer, dict) else None
            raise self._error(str(refused or "this is no emulator's control channel")[:200])

    def _error(self, what: str) -> DeviceError:
        return DeviceError(
            what,
            where=f"control channel {self._address}",
            fix="give --control the address that hdbench emulate prints, or leave it out",
        )


def hidden_effects(profile: Profile, plant: str, seed: int) -> tuple[Mapping[str, object], ...]:
    """Return the effects that a plant adds to the torque with this seed."""
    from hdbench.plant.bench import SimulatedBench
    from hdbench.plant.plantfile import load_plant

    effects = SimulatedBench(profile.data, load_plant(plant), seed).truth()["effects"]
    return tuple(effects) if isinstance(effects, list) else ()


Kind = Literal["wrong-weight", "swing", "early-release"]
MISTAKES: dict[Kind, str] = {
    "wrong-weight": "hangs another weight of the set, or the one named in kg",
    "swing": "lets the weight swing and does not steady it; at an angle in rad, or by the seed",
    "early-release": "takes the weight off again before it was read; after a time in s, or 0.7 s",
}
_WORD = re.compile(r"(wrong-weight|swing|early-release)@(\d{1,4})(?::(\d+(?:\.\d+)?))?")

# angles drawn for a swing: the vertical force then varies by 1 % to 6 %
_SWING_RAD = (0.1, 0.25)
# below the shortest average that a reading takes
_RELEASE_S = 0.7
# random streams of the simulated bench begin with its seed; this one is the operator's
_STREAM = 0x0B5E55
_BURN_PERIOD_S = 0.01  # any period that a node takes


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake.

    Parameters
    ----------
    kind : str
        ``wrong-weight``, ``swing`` or ``early-release``.
    number : int
        Point of the calibration's sequence at which it is made, from 1; once.
    size : float or None
        Mass in kg, angle in rad, time in s; None lets the seed choose.
    """

    kind: Kind
    number: int
    size: float | None = None


def parse_mistakes(text: str) -> tuple[Mistake, ...]:
    """Read a list of mistakes."""
    found = []
    for word in filter(None, (part.strip() for part in text.split(","))):
        match = _WORD.fullmatch(word)
        if match is None or int(match[2]) < 1:
            raise UsageError(
                f"{word!r} is no mistake; needed: {', '.join(MISTAKES)} with @ and a point",
                where="--operator-mistakes",
                fix="for example wrong-weight@5,swing@7,early-release@9",
            )
        size = None if match[3] is None else float(match[3])
        found.append(Mistake(cast("Kind", match[1]), int(match[2]), size))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Mistakes:
    """Which mistakes are made, and how large they are.

    Parameters
    ----------
    planned : sequence of Mistake
        What was asked for.
    masses_kg : sequence of float
        Weights at hand, kg.
    seed : int
        Chooses the sizes that are not given, >= 0.
    """

    planned: Sequence[Mistake] = ()
    masses_kg: Sequence[float] = ()
    seed: int = 0

    def of(self, number: int, attempt: int) -> dict[Kind, float]:
        """Return the sizes of the mistakes at one loading."""
        if attempt != 1:
            return {}
        return {m.kind: self._size(m) for m in self.planned if m.number == number}

    def other_mass_kg(self, mass_kg: float, number: int) -> float:
        """Return a weight of the set other than `mass_kg`, kg; without any, twice it or 1 kg."""
        others = [mass for mass in self.masses_kg if mass != mass_kg]
        if not others:
            return 2.0 * mass_kg or 1.0
        return float(self._draws(number).choice(others))

    def _size(self, mistake: Mistake) -> float:
        if mistake.size is not None:
            return mistake.size
        if mistake.kind == "swing":
            return float(self._draws(mistake.number).uniform(*_SWING_RAD))
        return _RELEASE_S if mistake.kind == "early-release" else float("nan")

    def _draws(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, _STREAM, number])


@dataclass(slots=True)
class _Fixture:
    locked: bool = False
    position_rad: float = 0.0
    mass_kg: float = 0.0
    direction: int = 1
    shunt_ohm: float = 0.0

    def to_dict(self) -> dict[str, float]:
        return {name: float(value) for name, value in asdict(self).items()}


@dataclass(eq=False)
class SimulatedOperator:
    """Does at once what a person would be asked to do, without error but for chosen mistakes.

    Implements `hdbench.devices.bench.Operator`; in a calibration it moves things, too.

    Parameters
    ----------
    bench : Bench
        The driver of a simulated bench.
    mistakes : Mistakes, optional
        What goes wrong, and when.
    shunt_ohm : float
        The resistor at hand, ohm; 0 none.
    fresh : bool
        Whether the bench begins with this session; otherwise it has kept its fixture.
    motion : callable, optional
        Asked before a motion; left out, every motion is allowed.

    Raises
    ------
    UsageError
        If `bench` has no control channel.
    """

    bench: Bench
    mistakes: Mistakes = Mistakes()
    _: KW_ONLY
    shunt_ohm: float = 0.0
    fresh: bool = True
    motion: Callable[[str], bool] = lambda _: True

    def __post_init__(self) -> None:
        if self.bench.simulation is None:
            raise UsageError(
                "a real bench needs a person beside it",
                where="bench",
                fix="run the command on a terminal, without --no-input",
            )
        self._simulation = self.bench.simulation
        self._now = _Fixture()
        self._history: list[dict[str, float]] = []

    # -- motion runs ------------------------------------------------------------------------------

    def confirm_lock(self, *, locked: bool) -> bool:
        """Lock or release the wave generator; released, nothing hangs on the arm."""
        self.mount(locked=locked, position_rad=self._now.position_rad)
        return True

    def set_position(self, position_rad: float, *, index: int, count: int) -> bool:
        """Turn the unloaded flexspline to `position_rad`, rad."""
        self.mount(locked=self._now.locked, position_rad=position_rad)
        return True

    def hang(self, mass_kg: float, *, direction: str, expected_nm: float, step: str) -> bool:
        """Hang `mass_kg` on the arm for `direction` (``cw`` or ``ccw``)."""
        self._now.mass_kg, self._now.direction = mass_kg, {"cw": 1, "ccw": -1}[direction]
        self._set()
        return True

    def confirm_motion(self, description: str) -> bool:
        """Allow the motion of a bench beside which nobody stands, or ask."""
        return self.motion(description)

    # -- calibrations -----------------------------------------------------------------------------

    def mount(self, *, locked: bool, position_rad: float) -> None:
        """Lock or release the wave generator and turn the unloaded flexspline, rad."""
        self._now.locked, self._now.position_rad = locked, position_rad
        self._now.mass_kg, self._now.direction = 0.0, 1
        self._set()

    def put(self, mass_kg: float, *, direction: str, number: int, attempt: int) -> None:
        """Hang a weight, with the mistakes planned for it.

        Parameters
        ----------
        mass_kg : float
            What is asked for, kg; 0 takes everything off.
        direction : str
            ``cw`` or ``ccw``.
        number : int
            Point of the sequence.
        attempt : int
            Which time it is loaded, from 1.
        """
        wrong = self.mistakes.of(number, attempt)
        if "wrong-weight" in wrong:
            named = wrong["wrong-weight"]
            mass_kg = self.mistakes.other_mass_kg(mass_kg, number) if math.isnan(named) else named
        self._handle(wrong.get("swing", 0.0), wrong.get("early-release", 0.0))
        self.hang(mass_kg, direction=direction, expected_nm=0.0, step="")
        if "early-release" in wrong:
            # what a bench that is opened later finds: the weight is off
            self._history[-1]["mass_kg"] = 0.0

    def shunt(self, *, closed: bool) -> bool:
        """Switch the shunt resistor; False where the bench has none."""
        if not self.shunt_ohm > 0.0:
            return False
        self._now.shunt_ohm = self.shunt_ohm if closed else 0.0
        self._handle(0.0, 0.0)
        self._history.append(self._now.to_dict())
        return True

    def history(self) -> list[dict[str, float]]:
        """Return every change so far, for `restore`."""
        return [dict(change) for change in self._history]

    def restore(self, history: list[dict[str, float]], acquisitions: int) -> None:
        """Bring the bench to where an earlier session left it.

        Parameters
        ----------
        history : list of dict
            What `history` returned there.
        acquisitions : int
            How many acquisitions the earlier session began.

        Notes
        -----
        A simulated bench that begins anew numbers its clampings and acquisitions from the start
        and draws the gain of a clamping and the noise of an acquisition by that number: both are
        gone through again, so that gain and zero go on as they were and no noise comes twice.
        """
        changes = history if self.fresh else history[-1:]
        for change in changes:
            self._now = _Fixture(
                bool(change["locked"]),
                change["position_rad"],
                change["mass_kg"],
                int(change["direction"]),
                change["shunt_ohm"],
            )
            self._set()
        if changes:
            self._handle(0.0, 0.0)
        self._history = [dict(change) for change in history]
        for _ in range(acquisitions if self.fresh else 0):
            self.bench.configure(AcquisitionSettings(_BURN_PERIOD_S, 1, None))
            self.bench.start()
            self.bench.stop()

    def _handle(self, swing_rad: float, release_s: float) -> None:
        shunt_ohm = self._now.shunt_ohm
        handling = {"swing_rad": swing_rad, "release_s": release_s, "shunt_ohm": shunt_ohm}
        self._simulation.set(handling=handling)

    def _set(self) -> None:
        fixture = asdict(self._now)
        del fixture["shunt_ohm"]
        self._simulation.set(fixture=fixture)
        self._history.append(self._now.to_dict())
