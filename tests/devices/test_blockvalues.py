"""Codes of a block to volts, amperes and counts, against the definition, scan by scan."""

import numpy as np
import pytest

from hdbench.devices.node.blocks import DATA_AT, ScanDecoder
from hdbench.devices.node.registers import ENCODER_HIGH, block_scans

LIMITS = {
    "range_v": 10.0, "current_range_a": 5.0, "converter_bits": 16,
    "limit_velocity_rad_s": 400.0, "encoder_counts_per_turn": 4000,
}  # fmt: skip
ROLES = ("torque", "tacho", "current", "reference", "encoder")


def wire(words):
    """Return a block's bytes: an empty header and big-endian words."""
    return bytes(DATA_AT) + np.asarray(words).astype(">i2").tobytes()


@pytest.mark.parametrize("period_s", [1e-3, 0.1])
@pytest.mark.parametrize("step", [0, 1, -1, 250, -250])
@pytest.mark.parametrize("near", [0, 2**15, -(2**15), 2**16, 2**31 - 5000, -(2**31) + 5000])
def test_counts_are_those_of_the_encoder_wherever_its_words_wrap(near, step, period_s):
    decoder = ScanDecoder(ROLES, period_s, LIMITS)
    whole = bool(decoder.bits & ENCODER_HIGH)
    n = block_scans(decoder.bits.bit_count())
    for offset in range(n):
        counts = near + step * (np.arange(n) - offset)
        wrapped = counts.astype(np.int64) & 0xFFFFFFFF
        low = (wrapped & 0xFFFF).astype(np.uint16).view(np.int16)
        high = (wrapped >> 16).astype(np.uint16).view(np.int16)
        words = np.column_stack([np.zeros((n, 4), np.int16), *([high] if whole else []), low])
        values, _ = decoder.decode(wire(words), n, int(counts[0]))
        assert np.array_equal(values[:, -1], counts)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_every_code_is_scaled_and_only_the_two_ends_are_marked(bits):
    decoder = ScanDecoder(("torque", "current"), 1e-3, {**LIMITS, "converter_bits": bits})
    step = 1 << (16 - bits)
    codes = np.arange(-32768, 32768, step)
    n = block_scans(2)
    for first in range(0, len(codes), n):
        part = codes[first : first + n]
        values, saturated = decoder.decode(wire(np.column_stack([part, part])), len(part), 0)
        assert np.array_equal(values[:, 0], part * (10.0 / 32768.0))
        assert np.array_equal(values[:, 1], part * (5.0 / 32768.0))
        ends = (part == -32768) | (part == 32768 - step)
        assert np.array_equal(saturated, np.column_stack([ends, ends]))
