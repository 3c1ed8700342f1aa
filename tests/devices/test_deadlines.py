"""A deadline is a moment on the clock: nothing that is tried within it begins it anew."""

import pytest
from daqkit import ScriptedLine

from hdbench.devices.node.access import NodeAccess
from hdbench.devices.node.registers import LIMITS, register
from hdbench.errors import DeviceError

DEADLINE_S = 0.2


@pytest.mark.parametrize(
    "call",
    [lambda wire: wire.read(LIMITS), lambda wire: wire.write_once((register("command"),), b"\0\1")],
    ids=["read", "write"],
)
def test_the_reason_of_a_refusal_is_asked_for_in_what_is_left(call):
    line = ScriptedLine(2, 2, takes_s=0.45 * DEADLINE_S)
    wire = NodeAccess(line, deadline_s=DEADLINE_S, clock=line)
    end_s = line.now_s + DEADLINE_S + 1e-9
    with pytest.raises(DeviceError, match="refused"):
        call(wire)
    assert len(line.untils_s) == 2, "the request, and why it was refused"
    assert max(*line.untils_s, line.now_s) <= end_s
