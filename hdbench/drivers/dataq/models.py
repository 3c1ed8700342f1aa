"""What the models differ in: channels, ranges, clock, resolution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["MODELS", "Model"]

_RANGES_4108 = {10.0: 0, 5.0: 1, 2.0: 2, 1.0: 3, 0.5: 4, 0.2: 5}
_RANGES_4208 = {100.0: 0, 50.0: 1, 20.0: 2, 10.0: 3, 5.0: 4, 2.0: 5}
# codes 0 to 5 have bit 11 clear, 8 to 13 have it set
_RANGES_2008 = {
    0.5: 0, 0.25: 1, 0.1: 2, 0.05: 3, 0.025: 4, 0.01: 5,
    50.0: 8, 25.0: 9, 10.0: 10, 5.0: 11, 2.5: 12, 1.0: 13,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Model:
    """One model.

    Parameters
    ----------
    number : str
        What it tells as its model: ``2108``.
    ranges : mapping of float to int
        Input range +-, V, to its code in a scan-list word.
    dividend : float
        Rate = dividend / (srate dec deca), Hz.
    srate_min, srate_max, dec_max, deca_max : int
        Limits of the three numbers; 1 where the model has no such command.
    throughput : bool
        Whether that is the rate of all entries together, else of each.
    bits : int
        Resolution; words are left-justified.
    digital : bool
        Whether the digital inputs can be an entry of the scan list.
    srate_step : int
        What each entry beyond the first adds to `srate_min`.
    single_dividend : float
        `dividend` where the list has one entry; 0 for the same.
    """

    number: str
    ranges: Mapping[float, int] = field(default_factory=lambda: {10.0: 0})
    dividend: float = 60e6
    srate_min: int = 375
    srate_max: int = 65535
    dec_max: int = 512
    deca_max: int = 40000
    throughput: bool = False
    bits: int = 16
    digital: bool = True
    srate_step: int = 0
    single_dividend: float = 0.0

    def shortest(self, entries: int) -> int:
        """Return the smallest srate with a list of so many entries."""
        return self.srate_min + self.srate_step * (entries - 1)

    def clock_hz(self, entries: int) -> float:
        """Return the dividend, Hz, for the rate of each of so many entries."""
        dividend = self.single_dividend if entries == 1 and self.single_dividend else self.dividend
        return dividend / entries if self.throughput else dividend


# DATAQ, "Data Acquisition Instrument Command Protocol", 1 Aug 2019, pages 48 and 60 to 70; ranges
# of the DI-2008 as in its maker's example program
MODELS: Mapping[str, Model] = {
    "DI-1100": Model(
        "1100", srate_min=1500, srate_step=500, dec_max=1, deca_max=1, bits=12, digital=False
    ),
    "DI-1110": Model("1110", dec_max=1, bits=12),
    "DI-1120": Model("1120", _RANGES_4208, bits=14),
    "DI-2008": Model(
        "2008", _RANGES_2008, 800.0, 4, 2232, 32767, 1, throughput=True, single_dividend=8000.0
    ),
    "DI-2108": Model("2108"),
    "DI-2108P": Model(
        "2108P", {10.0: 0, 5.0: 1, 2.5: 2}, 120e6, 750, 65535, 512, 1, throughput=True
    ),
    "DI-4108": Model("4108", _RANGES_4108),
    "DI-4208": Model("4208", _RANGES_4208),
    "DI-4718B": Model("4718B", {5.0: 0}),
}
