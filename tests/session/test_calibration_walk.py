"""A calibration asks once, keeps everything, and is guarded at every weight."""

import signal
from dataclasses import replace
from pathlib import Path

import pytest
from calibrationkit import GAIN, LEVER, PROFILE, FakeHands, Scripted, blocks, make_walk, walked
from changing import with_keys
from fakes import FakeBench

from hdbench.errors import BusyError, DeviceError, Stopped
from hdbench.profile.calibrating import ShuntCheck
from hdbench.records.counted import journal_loads, write_sequence
from hdbench.records.journal import read_journal
from hdbench.session.calibrating.conversation import Answer, Reply, Unattended
from hdbench.session.calibrating.plan import calibration_points
from hdbench.session.stop import Aborted, StopRequested, StopSignals

# the short sequence: bridge at rest, then 0, 0.5, 1, 0.5, 0 kg as points 2 to 6
MASSES = [0.0, 0.5, 1.0, 0.5, 0.0]


def loads(folder: Path):
    return journal_loads(read_journal(folder / "journal.hdj"), "journal")


def test_a_person_is_asked_for_each_change_once_and_every_load_is_read(tmp_path):
    talk = Scripted()
    walk = walked(tmp_path, talk=talk)
    assert [r.mass_kg for r in loads(tmp_path).readings] == MASSES
    # the fake reads torque / 6.6 with a 0.1 mV cosine on it
    for reading in loads(tmp_path).readings:
        assert reading.reading_v == pytest.approx(reading.torque_nm / GAIN, abs=1e-4)
    assert len(talk.asked("lock")) == len(talk.asked("place")) == 1
    # no weight twice in a row: the first zero needs no hands after the bridge at rest
    hung = talk.asked("hang")
    assert ["0.5 kg" in t for t in hung] == [False, True, False, True, False]
    assert "Expect +4.903 N m, +0.743 V" in hung[2]
    assert talk.asked("last")
    assert walk.safe is not None
    assert walk.safe.confirmed


@pytest.mark.parametrize("kept", [False, True])
def test_a_wrong_weight_is_asked_about_and_its_reading_is_kept_marked(tmp_path, kept):
    talk = Scripted([("did you hang", Answer.ACCEPT)] if kept else [])
    walked(tmp_path, talk=talk, hands=FakeHands(wrong={4: 0.5}))
    (question,) = talk.asked("gross-error")
    assert "expected +4.90 N m, read +2.45 N m: did you hang 0.5 kg?" in question
    assert [r.mass_kg for r in loads(tmp_path).readings] == MASSES
    rejected = [body for _, body in blocks(tmp_path) if body.get("event") == "rejected"]
    wrong_v = pytest.approx(0.5 * LEVER / GAIN, abs=1e-4)
    assert [body["reading_v"] for body in rejected] == ([] if kept else [wrong_v])
    flags = loads(tmp_path).extra_columns["flags"]
    assert flags == ("", "", "confirmed-gross-error" if kept else "", "", "")
    rows = write_sequence(tmp_path, read_journal(tmp_path / "journal.hdj")).read_text()
    assert rows.count("rejected,confirmed-gross-error") == (not kept)


def test_repeat_reads_the_hanging_weight_again_and_back_asks_for_the_one_before(tmp_path):
    talk = Scripted([("Hang 1 kg", Answer.REPEAT), ("Hang 1 kg", Answer.BACK)])
    walked(tmp_path, talk=talk)
    assert [r.mass_kg for r in loads(tmp_path).readings] == MASSES
    # 0.5 kg was read three times, hung twice; all three stand in the journal
    kept = [body for kind, body in blocks(tmp_path) if kind == "reading" and body["point"] == 3]
    assert len(kept) == 3
    course = write_sequence(tmp_path, read_journal(tmp_path / "journal.hdj")).read_text()
    superseded = [row.split(",")[13] for row in course.splitlines()[1:]]
    assert (superseded.count("repeat"), superseded.count("back")) == (1, 1)
    assert sum("Hang 0.5 kg" in t for t in talk.asked("hang")) == 3  # up, again after back, down


def test_the_last_reading_can_be_repeated_before_it_is_finished(tmp_path):
    talk = Scripted([("Finish", Answer.REPEAT)])
    walked(tmp_path, talk=talk)
    assert len(talk.asked("last")) == 2
    assert sum(kind == "reading" for kind, _ in blocks(tmp_path)) == 6
    assert len(loads(tmp_path)) == 5


def test_there_is_no_way_back_over_a_mounting(tmp_path):
    profile = with_keys(PROFILE, calibration={"positions": 2})
    talk = Scripted([("p2-cw-low 1 of 5", Answer.BACK), ("p1-cw-low 1 of 5", Answer.BACK)])
    walked(tmp_path, talk=talk, profile=profile)
    assert sum("no reading to go back to" in line for line in talk.told) == 1
    assert len(loads(tmp_path)) == 10


def test_a_skipped_point_is_left_out_and_back_opens_it_again(tmp_path):
    walk = walked(tmp_path, talk=Scripted([("Hang 1 kg", Answer.SKIP)]))
    assert [r.mass_kg for r in loads(tmp_path).readings] == [0.0, 0.5, 0.5, 0.0]
    assert walk.log.state.skipped == {4}
    other = tmp_path / "other"
    # from the last zero back over the 0.5 kg on the way down to the 1 kg that was skipped
    answers = [("Hang 1 kg", Answer.SKIP), ("5 of 5", Answer.BACK), ("4 of 5", Answer.BACK)]
    walked(other, talk=Scripted(answers))
    assert [r.mass_kg for r in loads(other).readings] == MASSES


def test_keys_while_the_reading_settles_are_obeyed(tmp_path):
    for key, taken in ((Answer.ACCEPT, 5), (Answer.REPEAT, 5), (Answer.SKIP, 4), (Answer.BACK, 6)):
        folder = tmp_path / key.value
        talk = Scripted()
        # the fake settles in ten blocks: nine looks for each point, the 25th is at the third
        talk.keys = {25: key}
        walked(folder, talk=talk)
        found = sum(kind == "reading" for kind, _ in blocks(folder))
        if key is Answer.ACCEPT:
            assert "not-settled" in loads(folder).extra_columns["flags"][1]
        assert found == taken, key


def test_a_reading_that_never_settles_is_asked_about(tmp_path):
    class Drifting(FakeBench):
        def read_block(self):
            block = super().read_block()
            return block and replace(block, torque_v=block.torque_v + 1e-3 * block.first_index)

    talk = Scripted([("not steady", Answer.REPEAT), ("the bridge rests at", Answer.ACCEPT)])
    points = calibration_points(PROFILE)[:1]
    walked(tmp_path, talk=talk, bench=Drifting(), points=points)
    assert len(talk.asked("time-out")) == 2
    assert "not steady after 30 s" in talk.asked("time-out")[0]
    (done,) = [body for _, body in blocks(tmp_path) if body.get("event") == "prepared"]
    assert done["flags"].startswith("timeout")


def test_nothing_is_hung_while_the_bridge_at_rest_is_off(tmp_path):
    hands = FakeHands(wrong={1: 1.0})
    talk = Scripted([("the bridge rests at", Answer.QUIT)])
    with pytest.raises(Stopped) as stopped:
        walked(tmp_path, talk=talk, hands=hands)
    assert stopped.value.exit_code == 130
    assert "is a weight on the arm" in talk.asked("gross-error")[0]
    assert hands.bench.calls[-1] == "safe_state"


def test_a_bridge_without_room_for_the_heaviest_weight_is_told(tmp_path):
    talk = Scripted([("the range ends at", Answer.ACCEPT)])
    walked(tmp_path, talk=talk, profile=with_keys(PROFILE, daq={"range_v": 0.75}))
    assert any("the range ends at 0.75 V" in text for text in talk.asked("gross-error"))


def test_the_shunt_is_read_once_and_taken_off_before_the_first_weight(tmp_path):
    shunt = ShuntCheck(resistor_ohm=87150.0, expected_v=1.2, tolerance=0.01)
    hands = FakeHands()
    talk = Scripted([("the shunt changes the reading", Answer.ACCEPT)])
    profile = with_keys(PROFILE, calibration={"shunt": shunt})
    walked(tmp_path, talk=talk, hands=hands, profile=profile)
    assert hands.shunts == [True, False]
    (question,) = talk.asked("gross-error")
    assert "changes the reading by +1.0000 V; expected +1.2000 V" in question
    assert len(loads(tmp_path)) == 5


def test_without_a_person_the_right_weight_is_hung_again_three_times_at_most(tmp_path):
    class Stubborn(FakeHands):
        def put(self, mass_kg, *, number, **how) -> None:
            super().put(0.5 if number == 4 else mass_kg, number=number, **how)

    said: list[str] = []
    walked(tmp_path, talk=Unattended(said.append), hands=Stubborn())
    assert sum("hung again" in line for line in said) == 2
    assert sum("taken as it is, marked" in line for line in said) == 1
    assert loads(tmp_path).extra_columns["flags"][2] == "confirmed-gross-error"


def test_a_lock_that_slips_aborts_the_calibration(tmp_path):
    def slip(bench: FakeBench, name: str) -> None:
        if name == "start" and bench.calls.count("start") == 4:
            bench.count += 200

    bench = FakeBench(hook=slip)
    with pytest.raises(Aborted, match="locked wave generator moved"):
        walked(tmp_path, bench=bench)
    assert len(loads(tmp_path)) == 2
    assert bench.calls[-1] == "safe_state"


@pytest.mark.parametrize("call", ["configure", "start", "read_block", "stop"])
@pytest.mark.parametrize("after", [0, 3])
def test_whichever_call_fails_the_bench_is_made_safe_and_what_was_accepted_stays(
    tmp_path, call, after
):
    bench = FakeBench(fail_at=call, after=after)
    with pytest.raises(DeviceError, match=f"{call} failed"):
        walked(tmp_path, bench=bench)
    assert bench.calls[-1] == "safe_state"
    walked(tmp_path)
    assert [r.mass_kg for r in loads(tmp_path).readings] == MASSES


@pytest.mark.parametrize("at", range(1, 7))
def test_a_signal_at_any_question_or_reading_is_obeyed_and_the_rest_is_resumed(tmp_path, at):
    stop = StopSignals()

    def ask(bench: FakeBench, name: str) -> None:
        if name == "start" and bench.calls.count("start") == at:
            stop.note(signal.SIGINT, None)

    bench = FakeBench(hook=ask)
    with pytest.raises(StopRequested):
        walked(tmp_path, bench=bench, stop=stop)
    before = sum(kind == "reading" for kind, _ in blocks(tmp_path))
    walked(tmp_path)
    assert sum(kind == "reading" for kind, _ in blocks(tmp_path)) == 5
    assert before == max(0, at - 2)
    assert [r.mass_kg for r in loads(tmp_path).readings] == MASSES


@pytest.mark.parametrize("question", range(1, 9))
def test_quitting_at_any_question_loses_nothing_and_asks_nothing_twice(tmp_path, question):
    class Leaves(Scripted):
        def ask(self, asked):
            reply = super().ask(asked)
            return Reply(Answer.QUIT) if len(self.questions) == question else reply

    first = Leaves()
    with pytest.raises(Stopped, match="saved"):
        walked(tmp_path, talk=first)
    second = Scripted()
    walked(tmp_path, talk=second)
    asked = [q.text for q in first.questions[:-1]] + [q.text for q in second.questions]
    assert len(asked) == len(set(asked)) == 8
    assert [r.mass_kg for r in loads(tmp_path).readings] == MASSES


def test_a_kill_at_any_byte_of_the_journal_loses_no_accepted_reading(tmp_path):
    talk = Scripted([("Hang 1 kg", Answer.REPEAT), ("4 of 5", Answer.BACK)])
    whole = tmp_path / "whole"
    walked(whole, talk=talk)
    raw = (whole / "journal.hdj").read_bytes()
    # every 307th byte: a prime, so that cuts fall everywhere in a block
    for number, end in enumerate(range(200, len(raw), 307)):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "journal.hdj").write_bytes(raw[:end])
        kept = [body for kind, body in blocks(folder) if kind == "reading"]
        again = Scripted()
        walked(folder, talk=again)
        now = [body for kind, body in blocks(folder) if kind == "reading"]
        assert now[: len(kept)] == kept
        assert [r.mass_kg for r in loads(folder).readings] == MASSES


def test_two_processes_cannot_record_one_calibration(tmp_path):
    first = make_walk(tmp_path)
    assert first.log.state.pending()
    with pytest.raises(BusyError, match="another process records this run"):
        make_walk(tmp_path)


def test_on_resume_the_hands_get_every_change_of_the_simulated_bench(tmp_path):
    with pytest.raises(Stopped):
        walked(tmp_path, talk=Scripted([("Hang 1 kg", Answer.QUIT)]))
    hands, again = FakeHands(), Scripted()
    walked(tmp_path, talk=again, hands=hands)
    assert hands.restored[-1]["level_v"] == pytest.approx(0.5 * LEVER / GAIN)
    assert any("goes on after 2 readings" in line for line in again.told)
