"""The amplifier as `hdbench.devices.daq.Daq`.

A command is a line that ends with CR; the answer is the same line, ``=`` and the value:

    *IDN?       Example,BR-1,SERIAL,FIRMWARE
    PERIOD S    OK: sampling period, s
    START       OK: sample 0 is taken one period from now
    READ? K     samples from number K on, V, with commas; the same K gives the same samples
    STOP        OK
"""

import time

import numpy as np
import serial

from hdbench.devices.base import DeviceBase
from hdbench.devices.bench import Identity
from hdbench.devices.daq import Capabilities, InputInfo, ScanBlock, clean_text

from .table import BridgeTable

MAX_RATE_HZ, RANGE_V = 100.0, 10.0
# shares of the deadline after which a lost line is asked for again, and given up
_TRIES = (0.5, 1.0)


class BridgeDaq(DeviceBase):
    """Driver of one amplifier; `table` is ``[daq]`` of the profile."""

    def __init__(self, table):
        super().__init__(table.address)
        self._table = table
        self._port = None
        self._wanted = self._next = 0

    def capabilities(self):
        """Return what the amplifier can do."""
        return Capabilities(
            inputs=(InputInfo("torque", -RANGE_V, RANGE_V, bits=24),),
            max_rates_hz=(MAX_RATE_HZ,),
            min_rate_hz=1.0,
        )

    def configure(self, settings):
        """Set the sampling period and return it, s."""
        self.identity()
        self._ask("STOP")
        self._ask(f"PERIOD {settings.sample_period_s!r}")
        self._wanted, self._next = settings.n_samples, 0
        return settings.sample_period_s

    def start(self):
        """Start sampling."""
        self._ask("START")

    def read_block(self):
        """Return the next samples; None when none is ready yet."""
        before_s, first, values = time.monotonic(), self._next, []
        if first < self._wanted:
            said = self._ask(f"READ? {first}")
            values = [float(word) for word in said.split(",") if word][: self._wanted - first]
            if not values:
                time.sleep(0.005)  # the caller asks again at once
                return None
            self._next += len(values)
            if self._next == self._wanted:
                self._ask("STOP")
        volts = np.array(values).reshape(-1, 1)
        return ScanBlock(
            first_index=first,
            lost_before=0,
            values=volts,
            saturated=np.abs(volts) >= RANGE_V,
            running=self._next < self._wanted,
            watchdog_tripped=False,
            depth=0,
            read_s=(before_s, time.monotonic()),
        )

    def stop(self):
        """Stop sampling."""
        self._wanted = self._next
        self._ask("STOP")

    def close(self):
        """Close the port; never raises."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _who(self):
        """Return who answers; nothing is written before that is the device meant."""
        said = self._ask("*IDN?").split(",")
        if len(said) != 4 or said[:2] != ["Example", "BR-1"]:
            raise self._fault(f"{','.join(said)!r} answers; needed: Example,BR-1")
        return Identity(*said, simulated=said[2].startswith("sim-"))

    def _ask(self, command):
        """Return the answer to a command; a line that answers another one is dropped."""
        start_s, deadline_s = time.monotonic(), self._table.deadline_s
        try:
            if self._port is None:
                url = self._table.address.removeprefix("serial://")
                self._port = serial.serial_for_url(url, self._table.baud_bd)
            for share in _TRIES:
                self._port.write(f"{command}\r".encode())
                while (left_s := start_s + share * deadline_s - time.monotonic()) > 0.0:
                    self._port.timeout = left_s
                    line = clean_text(self._port.read_until(b"\r"))
                    if line.startswith(f"{command}="):
                        return line.partition("=")[2]
        except (OSError, ValueError) as error:
            self.close()
            raise self._fault(f"the port failed ({error})") from error
        raise self._fault(f"no answer to {command!r} in {deadline_s:g} s")

    def _fault(self, what):
        return self.error(what, "check cable, power and bit rate")


def probe(path):
    """Say who is on a serial port; raises where it is no such amplifier."""
    keys = {"driver": "example-bridge", "address": f"serial://{path}", "sample_period_s": 0.1}
    daq = BridgeDaq(BridgeTable(**keys))
    try:
        return f"bridge amplifier {daq.identity().serial}"
    finally:
        daq.close()
