"""Opening of the bench that a profile names; one process at a time has it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hdbench.devices.bench import SafeState
from hdbench.devices.driver import open_daq
from hdbench.devices.feasibility import host_settings
from hdbench.devices.guard.order import order_of
from hdbench.devices.guard.session import GuardProcess, guard_silence_s
from hdbench.devices.host.bench import HostedBench
from hdbench.devices.lock import exclusive, is_line, release
from hdbench.devices.operator import Simulation
from hdbench.devices.transactor import is_disturbed
from hdbench.devices.wire.address import numbered, parse_address
from hdbench.errors import BusyError, HdbenchError, UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.loader import Profile
from hdbench.profile.schema import ProfileData

if TYPE_CHECKING:
    from hdbench.devices.emulator.machine import Pace

EMBEDDED = "embedded"
# the emulator shares the processor with its host: both wait for the scheduler, no motor does. So
# it gets the longest watchdog time that a node takes, and a deadline below it.
_EMBEDDED_DEADLINE_S = 1.5
_EMBEDDED_WATCHDOG_S = 2.0
# one try of the guard of a run that has died, its braking included, and what it has asked last, s
_OTHERS_S = 5.0
_POLL_S = 0.05


@contextmanager
def open_bench(
    profile: Profile | ProfileData,
    *,
    plant: str = "as-modelled",
    seed: int = 0,
    address: str | None = None,
    realtime: bool = False,
    record: Path | None = None,
    guard_log: Path | None = None,
    control: str | None = None,
) -> Iterator[HostedBench]:
    """Open the bench of `profile` for one session.

    Parameters
    ----------
    profile : Profile or ProfileData
        The bench.
    plant : str
        Plant of the embedded bench, name or path.
    seed : int
        Seed of the embedded bench.
    address : str, optional
        ``embedded``, or where the device is; default: that of the profile.
    realtime : bool
        Whether the embedded bench samples by the wall clock instead of as fast as it is read.
    record : Path, optional
        File for the embedded node's changes of state.
    guard_log : Path, optional
        File in which the guard process notes that it had to stop the motor.
    control : str, optional
        Control channel of a simulated bench at `address`; the embedded one has its own.

    Yields
    ------
    HostedBench
        The bench; made safe is the caller's business, closed it is at the end.

    Raises
    ------
    DeviceError
        If nobody, or something else, answers.
    BusyError
        If another run holds the bench.
    ProfileError
        If the plant is invalid.
    UsageError
        If the address has another form, or seed or plant are out of their domain.
    """
    data = _data(profile)
    where = address or data.daq.address
    with ExitStack() as stack:
        watchdog_s, speed = data.daq.watchdog_s, 1.0
        simulation = emulator = None
        if where == EMBEDDED:
            from hdbench.devices.emulator.process import running_emulator

            pace: Pace = "realtime" if realtime else "fast"
            found = stack.enter_context(
                running_emulator(data, plant=plant, seed=seed, pace=pace, record=record)
            )
            speed = float(found.get("speed", 1.0))
            emulator = str(found["control"])
            simulation = Simulation(emulator, embedded=True)
            data = _at(data, found, deadline_s=max(data.daq.deadline_s, _EMBEDDED_DEADLINE_S))
            watchdog_s = max(watchdog_s, _EMBEDDED_WATCHDOG_S)
        else:
            data = _numbered(_at(data, {"address": where}))
            for name in addresses_of(data.daq):
                stack.enter_context(exclusive(name))
            if control is not None:
                simulation = Simulation(control, embedded=False)
        if simulation is not None:
            stack.callback(simulation.close)
        silence_s = guard_silence_s(watchdog_s, data.daq.deadline_s)
        bench = HostedBench(
            open_daq(data, data.daq),
            host_settings(data, watchdog_s=watchdog_s),
            start_guard=lambda: GuardProcess(
                order_of(data), silence_s, log=guard_log, emulator=emulator
            ),
            simulation=simulation,
            speed=speed,
        )
        stack.callback(bench.close)
        bench.claim()
        yield bench


def stop_bench(profile: Profile | ProfileData, *, address: str | None = None) -> SafeState:
    """Make the bench at `address` safe, whoever holds it.

    Parameters
    ----------
    profile : Profile or ProfileData
        The bench.
    address : str, optional
        Where the device is; default: that of the profile.

    Returns
    -------
    SafeState
        What was read back.

    Raises
    ------
    DeviceError
        If nobody, or something else, answers.
    UsageError
        If the address is the embedded bench, which lives only inside its own run.
    """
    data = _data(profile)
    where = address or data.daq.address
    if where == EMBEDDED:
        raise UsageError(
            "the embedded bench runs only inside the command that uses it",
            where="address embedded",
            fix="stop that command, or name the address of a device",
        )
    there = _at(data, {"address": where})
    *_, driving = there.daq.part_tables().values()
    if driving is there.daq:
        return _stopped(there)
    outputs = there.model_copy(update={"daq": driving})
    # at once: a frozen run may hold the line of the inputs for seconds
    with suppress(HdbenchError):
        _stopped(outputs)
    try:
        return _stopped(there)
    except HdbenchError as error:
        # whatever is the matter with the inputs, the part that drives the motor is stopped
        safe = _stopped(outputs)
        return replace(safe, confirmed=False, detail=f"{safe.detail}; but {error.what}")


def _stopped(data: ProfileData) -> SafeState:
    """Make a bench safe whose serial lines a run may have: a line has one master."""
    there = _numbered(data)
    for name in filter(is_line, addresses_of(there.daq)):
        release(name)
    return made_safe(there)


def made_safe(data: ProfileData) -> SafeState:
    """Make a bench safe through its driver, after checking who answers."""
    bench = HostedBench(open_daq(data, data.daq), host_settings(data))
    try:
        _check_identity(bench, data)
        return bench.safe_state()
    finally:
        bench.close()


def _check_identity(bench: HostedBench, data: ProfileData) -> None:
    """Check who answers: a device that is not the one meant is never written to.

    A serial line may have been left a moment ago by another host, or be in the hands of the guard
    of a run that has died: then it is asked again, each time after the line was quiet.
    """
    until_s = time.monotonic() + _OTHERS_S * any(map(is_line, addresses_of(data.daq)))
    while True:
        try:
            bench.identity()
            return
        except HdbenchError as error:
            passing = isinstance(error, BusyError) or is_disturbed(error)
            if not (passing and time.monotonic() < until_s):
                raise
        time.sleep(_POLL_S)


def addresses_of(table: Acquisition) -> tuple[str, ...]:
    """Return every address that the devices of a table take, in their shortest form."""
    return tuple(part.address.partition("?")[0] for part in table.part_tables().values())


def _at(data: ProfileData, found: Mapping[str, object], **changes: object) -> ProfileData:
    """Return the profile with keys of ``[daq]`` as they are found, parts of a composite too."""
    table = data.daq
    update: dict[str, object] = {**changes, **found}
    for name, part in table.part_tables().items():
        below = update.get(name)
        if isinstance(below, Mapping):
            update[name] = part.model_copy(update={**changes, **below})
        if name:
            update["address"] = "parts"
    update = {key: value for key, value in update.items() if key in type(table).model_fields}
    return data.model_copy(update={"daq": table.model_copy(update=update)})


def _numbered(data: ProfileData) -> ProfileData:
    """Return the profile with numbers of hosts: nothing that moves, locks or guards asks again."""
    found: dict[str, object] = {}
    for part, table in data.daq.part_tables().items():
        keys: dict[str, object] = {"address": numbered(table.address)}
        tls = getattr(table, "tls", None)
        if tls is not None and keys["address"] != table.address and not tls.server_name:
            name = parse_address(table.address, default_port=802).host
            keys["tls"] = tls.model_copy(update={"server_name": name})
        found |= {part: keys} if part else keys
    return _at(data, found)


def _data(profile: Profile | ProfileData) -> ProfileData:
    return profile.data if isinstance(profile, Profile) else profile
