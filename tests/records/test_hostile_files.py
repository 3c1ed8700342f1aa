"""Whatever a file holds, it is read or refused with place and fix, never with anything else."""

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hdbench.errors import HdbenchError
from hdbench.profile import load_profile, parse_profile
from hdbench.records import read_trace
from hdbench.records.journal import JournalWriter, read_journal, survey_samples

TEXT = load_profile("cim-tr-97-06").text
TRACE = "time_s,torque_nm,tacho_v\n0.0,1.0,2.0\n0.001,1.5,2.5\n0.002,,nan\n"
PIECES = st.one_of(
    st.text(max_size=30),
    st.sampled_from(["nan", "inf", "-1", "1e999", "[", "]]", '"', "\0", "\n", "=", "9" * 400]),
)
FEW = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def spoiled(text):
    """Put pieces into `text` at any places, or take some of it away."""
    cuts = st.lists(st.tuples(st.integers(0, len(text)), st.integers(0, 30), PIECES), max_size=5)

    def apply(changes):
        found = text
        for at, gone, piece in changes:
            found = found[:at] + piece + found[at + gone :]
        return found

    return cuts.map(apply)


def refused(read):
    """Read; a refusal has all its parts, and anything else is a failure."""
    error = None
    try:
        read()
    except HdbenchError as found:
        error = found
    assert error is None or (error.what and error.where and error.fix)


@FEW
@given(spoiled(TEXT))
def test_profiles(text):
    refused(lambda: parse_profile(text, "hostile.toml"))


@FEW
@given(text=spoiled(TRACE))
def test_traces(tmp_path, text):
    path = tmp_path / "hostile.csv"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    refused(lambda: read_trace(path))


@FEW
@given(data=st.data())
def test_journals_both_ways_of_reading_find_the_same(tmp_path, data):
    path = tmp_path / "hostile.hdj"
    path.unlink(missing_ok=True)
    with JournalWriter(path) as writer:
        for number in range(4):
            writer.append("samples", {"time_s": [float(number)], "torque_v": [1.0]})
    raw = bytearray(path.read_bytes())
    for at, value in data.draw(
        st.lists(st.tuples(st.integers(0, len(raw) - 1), st.integers(0, 255)), max_size=4)
    ):
        raw[at] = value
    path.write_bytes(raw[: data.draw(st.integers(0, len(raw)))])
    found = []
    refused(lambda: found.append(read_journal(path)))
    if found:
        samples = [block for block in found[0].blocks if block.kind == "samples"]
        assert len(survey_samples(path)) == sum(len(b.columns["time_s"]) for b in samples)
