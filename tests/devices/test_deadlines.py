"""A deadline is a moment on the clock: nothing that is tried within it begins it anew."""

import pytest
from daqkit import Clock

from hdbench.devices.node.access import NodeAccess
from hdbench.devices.node.registers import LIMITS, register
from hdbench.devices.wire.link import ExceptionReply, FrameError
from hdbench.errors import DeviceError

DEADLINE_S = 0.2


class RefusingLink:
    """Refuses every request after a time, and notes until when it might have taken."""

    where = "nowhere"
    opened = None

    def __init__(self, clock, takes_s):
        self.clock = clock
        self.takes_s = takes_s
        self.untils_s = []

    def transact(self, pdu, check, until_s):
        self.untils_s.append(until_s)
        self.clock.sleep(min(self.takes_s, until_s - self.clock.now_s))
        if not self.clock.now_s < until_s:
            raise FrameError("no valid reply in time")
        raise ExceptionReply(2)

    def close(self):
        pass


@pytest.mark.parametrize(
    "call",
    [lambda wire: wire.read(LIMITS), lambda wire: wire.write_once((register("command"),), b"\0\1")],
    ids=["read", "write"],
)
def test_the_reason_of_a_refusal_is_asked_for_in_what_is_left(call):
    clock = Clock()
    link = RefusingLink(clock, 0.45 * DEADLINE_S)
    wire = NodeAccess(link, deadline_s=DEADLINE_S, clock=clock)
    start_s = clock.now_s
    with pytest.raises(DeviceError, match="refused"):
        call(wire)
    assert len(link.untils_s) == 2, "the request, and why it was refused"
    assert max(link.untils_s) <= start_s + DEADLINE_S + 1e-9
    assert clock.now_s <= start_s + DEADLINE_S + 1e-9
