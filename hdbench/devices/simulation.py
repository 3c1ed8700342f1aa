"""Control channel of a simulated bench: lock, position and weights, beside the device's wire.

One line of JSON each way on a loopback port, which the emulator alone opens. No device has it, so
that nothing a device says on its own wire can make it a simulated bench.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from typing import Any

from hdbench.devices.wire import dial, numbered, parse_address
from hdbench.errors import DeviceError
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
            self._ask({})
        except DeviceError:
            self.close()
            raise

    def set_fixture(
        self, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> None:
        """Lock or release the wave generator, turn the flexspline, hang a weight."""
        self._ask(
            {
                "fixture": {
                    "locked": locked,
                    "position_rad": position_rad,
                    "mass_kg": mass_kg,
                    "direction": direction,
                }
            }
        )

    def set_handling(self, *, swing_rad: float, release_s: float, shunt_ohm: float) -> None:
        """Set how the next weight is handled, and the resistor across the bridge."""
        values = {"swing_rad": swing_rad, "release_s": release_s, "shunt_ohm": shunt_ohm}
        self._ask({"handling": values})

    def close(self) -> None:
        """Close the channel."""
        self._socket.close()

    def _ask(self, order: dict[str, Any]) -> None:
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
        except ValueError as error:
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
