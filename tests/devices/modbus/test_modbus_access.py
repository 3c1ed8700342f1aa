"""Deadlines of a transaction, on a clock that goes when told; a write that is read back."""

import pytest
from daqkit import ScriptedLine
from modbuskit import KNOWN, OUTPUT, table

from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.outputs import Outputs
from hdbench.devices.registers import Register
from hdbench.devices.transactor import Transactor
from hdbench.devices.wire.link import FrameError
from hdbench.errors import DeviceError, ProfileError

PLACE = Register("holding 7", 7, "u16")
DEADLINE_S = 0.2


class Line(ScriptedLine):
    def access(self, *, min_gap_s=0.0, **keys):
        made = table(deadline_s=DEADLINE_S, min_gap_s=min_gap_s)
        return Access(self, made, clock=self, sleep=self.sleep, **keys)


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize(
    "script", [(), ("broken",), (6,) * 50, (6, 6, 6), ("broken", 6), (5, "broken")]
)
def test_a_call_that_fails_ends_at_its_deadline(numbered, script):
    line = Line(*script)
    access = line.access(numbered=numbered)
    for _ in range(3):
        start_s = line.now_s
        with pytest.raises(DeviceError, match=r"deadline 0\.2 s"):
            access.read([PLACE])
        assert line.now_s - start_s <= DEADLINE_S * (1 + 1e-9)


@pytest.mark.parametrize("numbered", [True, False])
def test_a_read_is_asked_for_again_once_and_a_write_never(numbered):
    line = Line("broken", "good")
    assert line.access(numbered=numbered).read([PLACE]) == [4242]
    assert len(line.sent_s) == 2
    line = Line("silent", "good")
    with pytest.raises(DeviceError):
        line.access(numbered=numbered).write(PLACE, 1.0)
    assert len(line.sent_s) == 1


def test_on_a_serial_line_nothing_is_read_while_a_late_reply_may_come():
    line = Line("silent", "good", "good")
    access = line.access(numbered=False)
    assert access.read([PLACE]) == [4242]
    # a try of 0.35 deadlines, and as much again
    assert line.sent_s[1] - line.sent_s[0] == pytest.approx(0.7 * DEADLINE_S)
    line.script = ["good"]
    before_s = line.now_s
    access.read([PLACE])
    assert line.sent_s[-1] == before_s


def test_after_a_fault_a_probe_follows_every_read_for_two_seconds():
    line = Line("broken", "good", "good", "good", "good")
    probes = []

    def probe(number):
        probes.append(number)
        return b"\x03\x00\x00\x00\x03", lambda pdu: None

    access = line.access(numbered=False, probe=probe)
    access.read([PLACE])
    access.read([PLACE])
    assert probes == [1, 2]
    line.now_s += 2.1
    line.script = ["good"]
    access.read([PLACE])
    assert probes == [1, 2]


def test_a_busy_device_is_asked_again_and_a_missing_register_is_not():
    line = Line(6, 5, "good")
    assert line.access().read([PLACE]) == [4242]
    assert len(line.sent_s) == 3
    refusals = {code: (ProfileError, f"exception {code}") for code in (1, 2, 3)}
    refusals[4] = (DeviceError, "device failure")
    for code, (error, words) in refusals.items():
        line = Line(code)
        with pytest.raises(error, match=words):
            line.access().read([PLACE])
        assert len(line.sent_s) == 1


def test_a_device_gets_its_rest_between_two_requests():
    line = Line("good", "good")
    access = line.access(min_gap_s=0.05)
    access.read([PLACE])
    access.read([PLACE])
    assert line.sent_s[1] - line.sent_s[0] == pytest.approx(0.051)


def test_a_write_that_the_device_has_taken_is_not_sent_again():
    """Exception 5 says "taken, still working"; 6 says "busy, nothing done"."""
    line = Line(6, 6, 5)
    with pytest.raises(DeviceError) as told:
        line.access(numbered=True).write(PLACE, 3.0)
    assert len(line.sent_s) == 3
    # what became of it has to be read back
    assert isinstance(told.value.__cause__, FrameError)
    line = Line(5, 5, "good")
    # a read moves nothing: it is asked again
    assert line.access(numbered=True).read([PLACE]) == [4242]


class LosingAccess:
    """Holds one register; every write is lost, and so is its answer."""

    where = "nowhere"
    error, _place = Transactor.error, Transactor._place

    def __init__(self, value):
        self.value = value

    def write(self, place, value, function=None):
        raise DeviceError("no answer", where="nowhere", fix="none") from FrameError("lost")

    def read(self, places):
        return [self.value]

    def pause(self):
        pass


def outputs(held, **keys):
    made = table(identify=(KNOWN,), output={**OUTPUT, **keys})
    return Outputs(LosingAccess(held), made, made.output)


@pytest.mark.parametrize("held", [999, 1001, 0])
def test_a_write_that_was_lost_is_not_believed_for_its_neighbour(held):
    with pytest.raises(DeviceError, match="reads back"):
        outputs(held).write(1.0)


@pytest.mark.parametrize("wanted_v", [1.0, 1.0004, 0.9996])
def test_what_stands_there_already_was_written_whatever_the_answer(wanted_v):
    assert outputs(1000).write(wanted_v) == pytest.approx(1.0)


def test_a_register_of_its_own_may_show_the_step_beside():
    shown = outputs(1001, read_back={"address": 300, "type": "i16", "table": "input"})
    assert shown.write(1.0) == pytest.approx(1.001)
    with pytest.raises(DeviceError, match="reads back"):
        outputs(1002, read_back={"address": 300, "type": "i16", "table": "input"}).write(1.0)
