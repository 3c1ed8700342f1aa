"""A node whose own scales make no sense is refused by name, before anything is written."""

import pytest
from faults.lines import emulated
from faults.replies import CountingBench

from hdbench.devices.emulator.machine import NodeMachine
from hdbench.devices.emulator.node import NodeCore
from hdbench.devices.emulator.parameters import identity_values, limit_values
from hdbench.devices.node.opening import open_node
from hdbench.errors import DeviceError
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06").data


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("converter_bits", 0),
        ("converter_bits", 24),
        ("range_v", 0.0),
        ("range_v", float("nan")),
        ("current_range_a", -1.0),
        ("limit_velocity_rad_s", float("inf")),
    ],
)
def test_a_scale_that_no_node_can_have_is_an_error_with_its_register(name, value):
    machine = NodeMachine(CountingBench(), pace="fast", clock=lambda: 0.0, record=lambda _: None)
    limits = {**limit_values(PROFILE), name: value}
    core = NodeCore(machine, identity=identity_values(0), limits=limits, clock=lambda: 0.0)
    with emulated(core) as address:
        table = PROFILE.daq.model_copy(update={"address": address})
        daq = open_node(PROFILE, table)
        with pytest.raises(DeviceError, match=name) as told:
            daq.capabilities()
        daq.close()
    assert f"register {name}" in told.value.where
