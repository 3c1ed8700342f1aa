"""A write is believed when it reads back, to the step."""

import pytest

from hdbench.devices.modbus.outputs import Outputs
from hdbench.devices.transactor import Transactor
from hdbench.devices.wire.link import FrameError
from hdbench.errors import DeviceError
from hdbench.profile.acquiring_modbus import ModbusAcquisition

TABLE = {
    "driver": "modbus",
    "sample_period_s": 0.1,
    "channels": (),
    "identify": ({"address": 104, "type": "u16", "equals": 4660},),
    "output": {"address": 200, "type": "i16", "scale": 0.001, "limit_v": 10.0},
}


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
    table = ModbusAcquisition.model_validate({**TABLE, "output": {**TABLE["output"], **keys}})
    return Outputs(LosingAccess(held), table, table.output)


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
