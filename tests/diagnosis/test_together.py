"""Several records of one drive: shared causes are found together, and who speaks is told."""

import numpy as np
import pytest
from swinging_shaft import NOISE_NM, swing, trace_of

from hdbench.diagnosis import diagnose_runs_together, diagnose_trace
from hdbench.diagnosis.together import diagnose_together
from hdbench.errors import DataError, UsageError
from hdbench.model import load_model, simulate_like
from hdbench.profile import load_profile
from hdbench.records import write_trace

PROFILE = load_profile("cim-tr-97-06")
NAMES = ("A", "B", "C")


def run(seed, ripple=0.0, coulomb=0.0, n=5000, rate_hz=1000.0, zero=0.0):
    """Return a run of the bench: its own speeds, zero and rate, one angle, order 6 and friction."""
    time = np.arange(n) / rate_hz
    lines = ((2.0, 0.4, 0.6), (4.0, 0.2, -1.1), (0.01, 0.9, 0.3), (6.0, ripple, 0.3))
    speed, angle, torque = swing(time, 60.0, 80.0 + 5.0 * seed, 4.0 + 0.3 * seed, lines)
    torque += zero + coulomb * np.tanh(speed / 0.5)
    torque += NOISE_NM * np.random.default_rng(seed).standard_normal(n)
    return trace_of(time, speed, angle, torque)


def told(result):
    return {cause.name: cause for cause in (*result.causes, *result.minor)}


def test_three_records_tell_together_what_none_tells_alone_and_each_how_much_it_speaks():
    # T = A^2 n / (2 noise^2) = 9, and 10 to 12 with this noise: below the 18 that 24 known orders
    # ask of one record
    traces = [run(5, 0.003, zero=0.2), run(9, 0.003, zero=-0.3), run(8, 0.003, rate_hz=800.0)]
    together = diagnose_together(traces, NAMES, PROFILE, materiality=0.0)
    for trace in traces:
        assert diagnose_trace(trace, PROFILE, materiality=0.0).causes == ()
    (cause,) = together.causes
    assert cause.name == "ripple-harmonic"
    assert cause.parameters["order"].value == 6.0
    size = cause.parameters["amplitude_nm"]
    # four standard deviations: 1.3e-4 that a right interval misses
    assert abs(size.value - 0.003) < 4.0 * size.std
    # the mean of three: noise sqrt(2 / n) of all
    assert size.std == pytest.approx(NOISE_NM * np.sqrt(2.0 / 15000), rel=0.1)
    assert cause.false_alarm_probability < 0.01
    assert [voice.record for voice in cause.voices] == list(NAMES)
    # 6 nats each on average, with a standard deviation of sqrt(12)
    assert all(voice.evidence_nats < 6.0 + 4.0 * np.sqrt(12.0) for voice in cause.voices)
    assert sum(voice.evidence_nats for voice in cause.voices) > cause.evidence_nats
    for voice in cause.voices:
        assert not voice.disagrees
        own = voice.parameters["amplitude_nm"]
        assert own.std == pytest.approx(NOISE_NM * np.sqrt(2.0 / 5000), rel=0.15)
    assert [part.rate_hz for part in together.records] == pytest.approx([1000.0, 1000.0, 800.0])
    assert together.settings["angle_zero"] == "shared"


def stuck(trace):
    return trace.with_columns(torque_nm=np.full(len(trace), 0.25))


def test_records_that_disagree_are_named_with_their_sizes_and_a_bad_one_is_left_out():
    traces = [run(1, 0.05), run(2, 0.05), run(3, 0.10), stuck(run(4))]
    result = diagnose_together(traces, (*NAMES, "D"), PROFILE)
    assert [part.record for part in result.records if part.left_out] == ["D"]
    (flag,) = (flag for flag in result.data_flags if flag.name == "record-left-out")
    assert (flag.record, flag.samples) == ("D", 5000)
    assert "0.25 N m throughout" in flag.detail
    assert [part.record for part in result.records if part.disagrees] == ["C"]
    cause = told(result)["ripple-harmonic"]
    assert [voice.record for voice in cause.voices if voice.disagrees] == ["C"]
    assert cause.disagreement.false_alarm_probability < 1e-6
    sizes = [voice.parameters["amplitude_nm"] for voice in cause.voices]
    for size, truth in zip(sizes, (0.05, 0.05, 0.10), strict=True):
        assert abs(size.value - truth) < 4.0 * size.std


@pytest.mark.campaign
def test_a_record_of_another_drive_is_told_by_what_it_disagrees_about():
    traces = [run(1, 0.05, 0.3), run(2, 0.05, 0.3), run(3, 0.0, 0.9)]
    result = diagnose_together(traces, NAMES, PROFILE)
    apart = {part.record: set(part.disagrees) for part in result.records}
    assert apart["A"] == apart["B"] == set()
    assert {"ripple-harmonic", "coulomb-friction"} <= apart["C"]


def test_one_good_record_is_not_together():
    with pytest.raises(DataError, match="1 of 2 records can be used") as error:
        diagnose_together([run(1), stuck(run(2))], NAMES[:2], PROFILE)
    assert "B: the torque is 0.25 N m throughout" in str(error.value)


def test_one_run_folder_holds_result_and_one_model_for_all(tmp_path):
    files = [tmp_path / f"{name}.csv" for name in NAMES[:2]]
    for file, seed in zip(files, (1, 2), strict=True):
        write_trace(file, run(seed, 0.05, n=4000))
    folder, result = diagnose_runs_together(files, PROFILE, out=tmp_path / "runs")
    assert len(list(folder.glob("**/model*.json"))) == 1
    assert [one.input for one in result.records] == [str(file) for file in files]
    (cause,) = result.causes
    assert [one.record for one in cause.voices] == [str(file) for file in files]
    assert cause.disagreement.records == ()
    for one in result.records:
        gain = one.simulated.heldout_rms_nm, one.extended.heldout_rms_nm
        # 0.05^2 / 2 of variance beside the noise, to the scatter of 4000 samples
        assert gain == pytest.approx((np.hypot(NOISE_NM, 0.05 / np.sqrt(2.0)), NOISE_NM), rel=0.05)
    model = load_model(folder / "model.json")
    simulated = simulate_like(run(1, n=4000), PROFILE.data, model)
    left = run(1, 0.05, n=4000)["torque_nm"] - simulated["torque_nm"]
    assert np.std(left) == pytest.approx(NOISE_NM, rel=0.1)


def test_what_cannot_be_taken_together_is_refused(tmp_path):
    one, copy = tmp_path / "one.csv", tmp_path / "copy.csv"
    for file in (one, copy):
        write_trace(file, run(1, n=500))
    with pytest.raises(UsageError, match="the same record as"):
        diagnose_runs_together([one, copy], PROFILE, out=tmp_path)
    with pytest.raises(UsageError, match="with 1 record"):
        diagnose_runs_together([one], PROFILE, out=tmp_path)
