"""A DATAQ instrument as `hdbench.devices.daq.Daq`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import NoReturn

import numpy as np

from hdbench.devices.bench import Identity, SafeState
from hdbench.devices.daq import Capabilities, DaqSettings, InputsOnly, Role, ScanBlock
from hdbench.drivers.dataq.abilities import describe_abilities
from hdbench.drivers.dataq.acquisition import Acquisition
from hdbench.drivers.dataq.commands import Commands
from hdbench.drivers.dataq.identity import check_identity
from hdbench.drivers.dataq.models import MODELS
from hdbench.drivers.dataq.rates import RateSetting, packet_code
from hdbench.drivers.dataq.scanlist import ScanPlan, plan_scan
from hdbench.drivers.dataq.scans import StreamFault
from hdbench.drivers.dataq.setup import set_up
from hdbench.drivers.dataq.table import DataqAcquisition
from hdbench.errors import DeviceError, HdbenchError

__all__ = ["DataqDaq"]

# one reading outside of an acquisition: a short stream at this period, and the time it may take
_LOOK_PERIOD_S = 0.002
_LOOK_SCANS = 8
_LOOK_S = 0.5


class DataqDaq(InputsOnly):
    """Driver of one instrument; implements `hdbench.devices.daq.Daq`.

    Parameters
    ----------
    commands : Commands
        The instrument; owned by the driver from now on.
    table : DataqAcquisition
        ``[daq]`` of the profile, or one part of a composite.
    clock : callable, optional
        Monotonic clock, s.

    Notes
    -----
    No model has an analog output, so this driver drives nothing: it is the inputs of a composite,
    or measures a bench that stands.
    """

    def __init__(
        self,
        commands: Commands,
        table: DataqAcquisition,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._commands = commands
        self._table = table
        self._clock = clock
        self._identity: Identity | None = None
        self._acquisition: Acquisition | None = None
        self._quiet = False

    def capabilities(self) -> Capabilities:
        """Return what the instrument can do as the profile wires it."""
        return describe_abilities(self._table, simulated=self.identity().simulated)

    def identity(self) -> Identity:
        """Return who answers; asked once. A stream that somebody left is stopped first."""
        if self._identity is None:
            self._be_quiet()
            self._identity = check_identity(self._commands, self._table)
        return self._identity

    def configure(self, settings: DaqSettings) -> float:
        """Send scan list, rate and packet size, and return the actual sample period, s."""
        self.identity()
        self._acquisition = None
        plan = plan_scan(self._table, settings.roles)
        rate = self._set_up(plan, settings.sample_period_s, self._table.average)
        code = packet_code(len(plan.words), rate.period_s)
        packet_s = (16 << code) / plan.scan_bytes * rate.period_s
        self._acquisition = Acquisition(
            plan,
            rate.period_s,
            packet_s,
            settings.n_samples,
            self._clock,
            encoder=self._encoder(settings.roles),
        )
        return rate.period_s

    def start(self) -> None:
        """Start scanning; sent once, and never echoed: the first packet is the proof."""
        acquisition = self._acquisition
        if acquisition is None or acquisition.started:
            raise self._error("no acquisition is configured", "configure it first")
        self._quiet = False
        self._commands.start()
        acquisition.begin()

    def read_block(self) -> ScanBlock | None:
        """Return the next scans; None when none has come yet."""
        acquisition = self._acquisition
        if acquisition is None or not acquisition.started:
            raise self._error("no acquisition has been started", "start it first")
        try:
            block = acquisition.next_block(self._commands.port)
        except StreamFault as fault:
            self._broken(acquisition, str(fault))
        if acquisition.complete and not acquisition.stopped:
            self._be_quiet()
            acquisition.stop(b"")
        if block is None and acquisition.silent:
            self._broken(acquisition, "the instrument no longer sends")
        return block

    def stop(self) -> None:
        """Stop scanning; scans already taken can still be read."""
        acquisition = self._acquisition
        if acquisition is None or not acquisition.sampling:
            return
        acquisition.stop(self._be_quiet())

    def snapshot(self) -> Mapping[Role, float]:
        """Return the mean of a short stream; empty while an acquisition has the inputs."""
        if self._acquisition is not None and self._acquisition.sampling:
            return {}
        # a counter says nothing without the counts before
        roles = tuple(c.role for c in self._table.channels if c.role != "encoder")
        plan = plan_scan(self._table, roles)
        rate = self._set_up(plan, self._look_period_s(len(plan.words)), 1)
        packet_s = 16.0 / plan.scan_bytes * rate.period_s
        # configured anew before the next acquisition
        self._acquisition = None
        look = Acquisition(plan, rate.period_s, packet_s, _LOOK_SCANS, self._clock)
        self._quiet = False
        self._commands.start()
        look.begin()
        try:
            return self._mean_of(look, roles)
        finally:
            self._be_quiet()

    def safe_state(self) -> SafeState:
        """Stop scanning; the instrument drives nothing. Never raises."""
        self._acquisition = None
        try:
            self._be_quiet()
        except HdbenchError as error:
            return SafeState(False, None, None, error.what)
        return SafeState(True, None, None, "the instrument drives nothing")

    def close(self) -> None:
        """Close the port; never raises."""
        self._commands.close()

    def _set_up(self, plan: ScanPlan, period_s: float, average: int) -> RateSetting:
        """Send every setting, the instrument being quiet."""
        self._be_quiet()
        return set_up(self._commands, MODELS[self._table.model], plan, period_s, average)

    def _encoder(self, roles: tuple[Role, ...]) -> tuple[int, int] | None:
        """Return counts per edge and the tacho's channel, where an encoder is sampled."""
        spec = next((c for c in self._table.channels if c.role == "encoder"), None)
        if spec is None or "encoder" not in roles:
            return None
        if "tacho" not in roles:
            raise self._error(
                "the counter knows no direction without the tacho", "add tacho to daq.channels"
            )
        return spec.counts_per_edge, roles.index("tacho")

    def _look_period_s(self, entries: int) -> float:
        """Return a period that the model has, near that of a short stream."""
        model = MODELS[self._table.model]
        srate = max(model.shortest(entries), round(model.clock_hz(entries) * _LOOK_PERIOD_S))
        return min(srate, model.srate_max) / model.clock_hz(entries)

    def _mean_of(self, look: Acquisition, roles: tuple[Role, ...]) -> dict[Role, float]:
        """Return the mean of the stream's scans; empty where too few came in time."""
        until_s = self._clock() + _LOOK_S
        values = []
        while not look.complete and self._clock() < until_s:
            try:
                block = look.next_block(self._commands.port)
            except StreamFault as fault:
                raise self._error(str(fault), _STEP) from fault
            if block is not None:
                values.append(block.values)
        if not look.complete:
            return {}
        mean = np.mean(np.concatenate(values), axis=0)
        return {role: float(value) for role, value in zip(roles, mean, strict=True)}

    def _be_quiet(self) -> bytes:
        """Stop a stream, one that a dead host has left included; return what it had sent."""
        if self._quiet:
            return b""
        left = self._commands.stop()
        self._quiet = True
        return left

    def _broken(self, acquisition: Acquisition, what: str) -> NoReturn:
        """Raise what has ended the stream."""
        done = f"after {acquisition.delivered} scans"
        if acquisition.overflowed:
            self._quiet = True
            raise self._error(
                f"the instrument's buffer ran over {done}, and it stopped",
                "free this computer of other work, sample more slowly, or name fewer channels",
            )
        raise self._error(f"{what} ({done})", _STEP)

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(what, where=self._commands.where, fix=fix)


_STEP = "run again; if it comes back, exchange the cable and leave the digital inputs open"
