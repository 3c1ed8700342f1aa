"""The program of the node's reference generator: parts as they are written, checked one by one."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hdbench.devices.emulator.parameters import RefusedError
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import PROGRAM, PROGRAM_WAVE, Refusal, register
from hdbench.model.program import MAX_PARTS, ProgramPart, ReferenceProgram

__all__ = ["ProgramStore"]

# values come as 32-bit floats, rounded by at most 6e-8 of their size
_ROUNDING = 1e-6


class ProgramStore:
    """Parts that a host has written.

    Parameters
    ----------
    limits : mapping
        The limits block, by register name.
    """

    def __init__(self, limits: Mapping[str, Value]) -> None:
        self._limits = limits
        self._parts: list[ProgramPart] = []
        self._needed = 0
        self.last: dict[str, Value] = {entry.name: 0 for entry in PROGRAM}

    def forget(self) -> None:
        """Forget the program."""
        self._parts, self._needed = [], 0
        self.last = {entry.name: 0 for entry in PROGRAM}

    def take(self, values: Mapping[str, Value], address: int) -> None:
        """Keep one part: part 0 begins a program, any other follows the one before it."""
        if len(values) != len(PROGRAM):
            raise RefusedError(3, Refusal.VALUE, address)
        number, needed = int(values["program_part"]), int(values["program_parts"])
        kept = self._parts[:number]
        # a part may be written again, as it is when the answer to a write was lost
        follows = number == len(kept) and (number == 0 or needed == self._needed)
        if not (1 <= needed <= MAX_PARTS and number < needed and follows):
            raise RefusedError(3, Refusal.VALUE, register("program_part").address)
        part = self._checked(values)
        self._parts, self._needed = [*kept, part], needed
        self.last = dict(values)

    def check(self, parameters: Mapping[str, Value]) -> ReferenceProgram | None:
        """Return the program that a parameter block asks for; None where it asks for none."""
        if parameters["wave"] != PROGRAM_WAVE:
            return None
        if not self._parts or len(self._parts) != self._needed:
            raise RefusedError(3, Refusal.WAVE, register("wave").address)
        program = ReferenceProgram(tuple(self._parts))
        if program.n_samples != int(parameters["n_samples"]):
            raise RefusedError(3, Refusal.SAMPLE_COUNT, register("n_samples").address)
        return program

    def _checked(self, values: Mapping[str, Value]) -> ProgramPart:
        """Return one part within the limits; a NaN is outside."""
        part = ProgramPart(
            int(values["part_samples"]),
            float(values["part_start_v"]),
            float(values["part_end_v"]),
            float(values["part_amplitude_v"]),
            float(values["part_frequency_hz"]),
            float(values["part_end_frequency_hz"]),
        )
        peak_rad_s = part.peak_v * float(self._limits["velocity_per_volt"])
        if not 1 <= part.n_samples <= int(self._limits["max_samples"]):
            raise RefusedError(3, Refusal.SAMPLE_COUNT, register("part_samples").address)
        if not part.peak_v <= float(self._limits["limit_reference_v"]) * (1.0 + _ROUNDING):
            raise RefusedError(3, Refusal.REFERENCE_LIMIT, register("part_start_v").address)
        if not peak_rad_s <= float(self._limits["limit_velocity_rad_s"]) * (1.0 + _ROUNDING):
            raise RefusedError(3, Refusal.VELOCITY_LIMIT, register("part_start_v").address)
        frequencies = (part.frequency_hz, part.end_frequency_hz)
        if not all(0.0 <= f < math.inf for f in frequencies):
            raise RefusedError(3, Refusal.VALUE, register("part_frequency_hz").address)
        return part
