"""What is wired to which terminal of the emulated device, and what its converters make of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.emulator.instrument import ElectricalSamples, Input, SimulatedInstrument
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.records.trace import FloatArray

__all__ = ["Calibration", "Wiring"]

# nominal constants of the T7's high-speed converter, one group per gain, and of the T4's inputs
_T7_SLOPE, _T7_CENTER = 3.1580578e-4, 33523.0
_T4_HIGH = (3.235316e-4, -10.532965)
_T4_LOW = (3.826692e-5, 0.002484)
_GAINS = (10.0, 1.0, 0.1, 0.01)
# how far one device is from the nominal one: a fraction of the data sheet's tolerance
_SPREAD = 2e-3
# a streamed analog input never reads 0xFFFF
_TOP = 0xFFFE
_FLASH_FLOATS = {"T7": 41, "T4": 19}
_QUADRATURE_LINES = {"T7": (0, 1), "T4": (4, 5)}


@dataclass(frozen=True, slots=True)
class Calibration:
    """The constants of one device, as its flash holds them.

    Parameters
    ----------
    model : str
        ``T7`` or ``T4``.
    floats : tuple of float
        The calibration block, 32-bit values.
    """

    model: str
    floats: tuple[float, ...]

    @classmethod
    def draw(cls, model: str, seed: int) -> Calibration:
        """Return the constants of the device with this serial number."""
        rng = np.random.default_rng([seed, 7])
        factor = 1.0 + _SPREAD * rng.uniform(-1.0, 1.0, 16)
        values: list[float] = []
        if model == "T7":
            for number in range(8):
                slope = _T7_SLOPE * _GAINS[number % 4] / 10.0 * factor[number]
                values += [slope, -slope * factor[8 + number], _T7_CENTER + number, -slope * 33524]
        else:
            for number in range(5):
                slope, offset = _T4_HIGH if number < 4 else _T4_LOW
                values += [slope * factor[number], offset * factor[8 + number]]
        values += [0.0] * (_FLASH_FLOATS[model] - len(values))
        return cls(model, tuple(np.array(values, dtype=np.float32).astype(float).tolist()))

    def words(self, volts: FloatArray, number: int, range_v: float) -> NDArray[np.uint16]:
        """Return the 16-bit words that AIN`number` streams for `volts`."""
        if self.model == "T4":
            slope, offset = self.floats[2 * min(number, 4) : 2 * min(number, 4) + 2]
            # a 12-bit converter: its lowest four bits stay zero
            raw = np.rint((volts - offset) / slope / 16.0) * 16.0
        else:
            at = 4 * _GAINS.index(range_v or 10.0)
            positive, negative, center = self.floats[at : at + 3]
            raw = np.rint(np.where(volts >= 0.0, volts / positive, -volts / negative) + center)
        words: NDArray[np.uint16] = np.clip(raw, 0, _TOP).astype(np.uint16)
        return words

    def volts(self, word: int, number: int, range_v: float) -> float:
        """Return the volts that the device itself makes of a word."""
        if self.model == "T4":
            slope, offset = self.floats[2 * min(number, 4) : 2 * min(number, 4) + 2]
            return word * slope + offset
        at = 4 * _GAINS.index(range_v or 10.0)
        positive, negative, center = self.floats[at : at + 3]
        return (word - center) * positive if word >= center else (center - word) * negative


class Wiring:
    """Terminals of the device to the instrument, as a profile says.

    Parameters
    ----------
    instrument : SimulatedInstrument
        The bench.
    table : LabJackAcquisition
        ``[daq]`` of the profile.
    current_v_per_v : float
        Volts at the terminal per volt of the instrument's current channel.
    seed : int
        Serial number: chooses the device's constants.
    """

    def __init__(
        self,
        instrument: SimulatedInstrument,
        table: LabJackAcquisition,
        *,
        current_v_per_v: float,
        seed: int,
    ) -> None:
        self.instrument = instrument
        self.model = table.model
        self.calibration = Calibration.draw(table.model, seed)
        self._analog: dict[int, tuple[Input, float]] = {}
        for channel in table.channels:
            if channel.role != "encoder":
                factor = current_v_per_v if channel.role == "current" else 1.0
                number = int(channel.input.removeprefix("AIN"))
                self._analog[number] = (channel.role, factor)
        output = table.output
        self.reference = output.output if output is not None else ""
        self.enable_line = output.enable_line if output is not None else -1
        self._enable_high = output.enable_high if output is not None else True

    @property
    def counter_line(self) -> int:
        """Line of the pair whose counter holds the encoder's count."""
        return _QUADRATURE_LINES[self.model][0]

    def write_reference(self, terminal: str, value_v: float) -> None:
        """Put a voltage out at a terminal; only that of the reference leads anywhere."""
        if terminal == self.reference:
            self.instrument.write_reference(value_v)

    def write_line(self, line: int, *, high: bool) -> None:
        """Set a line; only that of the enable leads anywhere."""
        if line == self.enable_line:
            on = high == self._enable_high
            if on != self.instrument.enabled:
                self.instrument.write_enable(on=on)

    def words(self, samples: ElectricalSamples, number: int, range_v: float) -> NDArray[np.uint16]:
        """Return what AIN`number` reads; an open terminal reads 0 V."""
        name, factor = self._analog.get(number, (None, 1.0))
        volts = np.zeros(len(samples)) if name is None else samples.volts[name] * factor
        return self.calibration.words(volts, number, range_v)
