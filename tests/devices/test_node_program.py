"""A program of the reference generator: written part by part, checked, put out without a pause."""

import math

import numpy as np
import pytest
from daqkit import Clock
from nodekit import PROFILE, TinyBench
from served import sampled

from hdbench.devices import open_bench
from hdbench.devices.bench import AcquisitionSettings
from hdbench.devices.daq import DaqSettings
from hdbench.devices.emulator.node import build_core
from hdbench.devices.emulator.server import ModbusRefusedError
from hdbench.devices.node.access import parameter_values, part_values
from hdbench.devices.node.registers import PARAMETERS, PROGRAM, PROGRAM_WAVE, Refusal, register
from hdbench.devices.registers import encode_group
from hdbench.profile.waves import ProgramPart, ReferenceProgram, program_voltage

PARTS = (
    ProgramPart(200, 0.0, 1.5),
    ProgramPart(300, 1.5, 1.5),
    ProgramPart(400, 1.5, 1.5, 0.5, 5.0, 5.0),
    ProgramPart(250, 1.5, 0.0),
)
PROGRAM_OF_FOUR = ReferenceProgram(PARTS)


def test_a_program_is_ramps_holds_and_sines_one_after_the_other() -> None:
    volts = program_voltage(PROGRAM_OF_FOUR, 0.001)
    time = 0.001 * np.arange(1150)
    expected = np.interp(time, [0.0, 0.2, 0.9, 1.15], [0.0, 1.5, 1.5, 0.0])
    swinging = (time >= 0.5) & (time < 0.9)
    expected[swinging] += 0.5 * np.sin(2.0 * math.pi * 5.0 * (time[swinging] - 0.5))
    # rounding of a few products
    np.testing.assert_allclose(volts, expected, atol=1e-12)


def test_the_embedded_bench_puts_out_the_program_and_follows_it() -> None:
    with open_bench(PROFILE, plant="as-modelled", seed=1, address=None, realtime=False) as bench:
        got = sampled(bench, AcquisitionSettings(0.001, 1150, PROGRAM_OF_FOUR))
        assert bench.safe_state().confirmed
    # half a code of the converter, and 32-bit floats
    np.testing.assert_allclose(got.reference_v, program_voltage(PROGRAM_OF_FOUR, 0.001), atol=2e-4)
    # the servo has the gain of the tacho and lags by a few time constants of 10 ms
    assert got.tacho_v[450:500] == pytest.approx(1.5, abs=0.01)


class ProgramBench(TinyBench):
    """Keeps what it is to put out, and stands still."""

    def begin(self, *, sample_period_s, wave, duration_s) -> None:
        self.begun.append((sample_period_s, wave, duration_s))


def written(parts: list[dict], n_samples: int = 1150):
    """Return a core into which parts and then the parameter block were written."""
    core = build_core(ProgramBench(), PROFILE, 0, pace="fast", clock=Clock())
    for part in parts:
        core.write("holding", PROGRAM[0].address, encode_group(PROGRAM, part), 1)
    settings = DaqSettings(("torque", "encoder"), 0.001, n_samples, 0.5, PROGRAM_OF_FOUR)
    limits = {
        "min_period_ns": 1, "max_period_ns": 10**9, "max_samples": 10**9,
        "watchdog_min_ms": 1, "watchdog_max_ms": 10**4, "limit_velocity_rad_s": 400.0,
        "encoder_counts_per_turn": 4000,
    }  # fmt: skip
    values = parameter_values(settings, limits)
    assert values["wave"] == PROGRAM_WAVE
    core.write("holding", PARAMETERS[0].address, encode_group(PARAMETERS, values), 1)
    return core


def test_a_whole_program_is_accepted_and_reads_back() -> None:
    parts = part_values(PROGRAM_OF_FOUR)
    # a part whose answer was lost is written again
    core = written([*parts, parts[-1]])
    raw = core.read("holding", PROGRAM[0].address, sum(entry.size for entry in PROGRAM), 1)
    assert raw == encode_group(PROGRAM, parts[-1])
    core.write("holding", register("command").address, b"\x00\x01", 1)
    (begun,) = core.machine.bench.begun
    assert begun[1] == PROGRAM_OF_FOUR


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda parts: parts[:-1], Refusal.WAVE),
        (lambda parts: [], Refusal.WAVE),
        (lambda parts: [parts[0], parts[2]], Refusal.VALUE),
        (lambda parts: [{**parts[0], "program_parts": 200}], Refusal.VALUE),
        (lambda parts: [{**parts[0], "part_samples": 0}], Refusal.SAMPLE_COUNT),
        (lambda parts: [{**parts[0], "part_samples": 201}, *parts[1:]], Refusal.SAMPLE_COUNT),
        (lambda parts: [{**parts[0], "part_end_v": 8.5}], Refusal.REFERENCE_LIMIT),
        (lambda parts: [{**parts[0], "part_end_v": math.nan}], Refusal.REFERENCE_LIMIT),
        (lambda parts: [{**parts[0], "part_amplitude_v": 5.9}], Refusal.VELOCITY_LIMIT),
        (lambda parts: [{**parts[0], "part_frequency_hz": math.inf}], Refusal.VALUE),
        (lambda parts: [{**parts[0], "part_frequency_hz": -1.0}], Refusal.VALUE),
    ],
)
def test_a_program_that_is_not_whole_or_beyond_a_limit_is_refused(change, reason) -> None:
    with pytest.raises(ModbusRefusedError) as refused:
        written(change(part_values(PROGRAM_OF_FOUR)))
    assert refused.value.exception == 3
    assert refused.value.reason == reason


def test_safe_forgets_the_program() -> None:
    core = written(part_values(PROGRAM_OF_FOUR))
    core.write("holding", register("command").address, b"\x00\x03", 1)
    assert core.read("holding", PROGRAM[0].address, 14, 1) == bytes(28)
