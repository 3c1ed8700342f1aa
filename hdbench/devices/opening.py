"""Open the bench that a profile names, and let one process at a time have it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from hdbench.devices.lock import exclusive
from hdbench.devices.ports import Bench, SafeState
from hdbench.errors import UsageError
from hdbench.profile.loader import Profile
from hdbench.profile.schema import ProfileData

if TYPE_CHECKING:
    from hdbench.devices.emulator.machine import Pace
    from hdbench.devices.node.driver import NodeBench

__all__ = ["open_bench", "parse_address", "stop_bench"]

EMBEDDED = "embedded"
# the emulator shares the processor with its host: both wait for the scheduler, no motor does. So
# it gets the longest watchdog time that a node takes, and a deadline below it.
_EMBEDDED_DEADLINE_S = 1.5
_EMBEDDED_WATCHDOG_S = 2.0


@contextmanager
def open_bench(
    profile: Profile | ProfileData,
    *,
    plant: str = "as-modelled",
    seed: int = 0,
    address: str | None = None,
    realtime: bool = False,
    model_file: Path | None = None,
    record: Path | None = None,
) -> Iterator[Bench]:
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
        ``embedded`` or ``tcp://HOST:PORT``; default: that of the profile.
    realtime : bool
        Whether the embedded bench samples by the wall clock instead of as fast as it is read.
    model_file : Path, optional
        Extended model that the embedded bench follows in place of the profile's.
    record : Path, optional
        File for the embedded node's changes of state.

    Yields
    ------
    Bench
        The bench; made safe is the caller's business, closed it is at the end.

    Raises
    ------
    DeviceError
        If nobody, or something else, answers.
    BusyError
        If another run holds the bench.
    ProfileError
        If the plant or the model file is invalid.
    UsageError
        If the address has another form, or seed or plant are out of their domain.
    """
    data = _data(profile)
    where = address or data.daq.address
    with ExitStack() as stack:
        if where == EMBEDDED:
            from hdbench.devices.emulator.process import running_emulator

            pace: Pace = "realtime" if realtime else "fast"
            host, port = stack.enter_context(
                running_emulator(
                    data, plant=plant, seed=seed, pace=pace, model_file=model_file, record=record
                )
            )
            deadline_s = max(data.daq.deadline_s, _EMBEDDED_DEADLINE_S)
            watchdog_s = max(data.daq.watchdog_s, _EMBEDDED_WATCHDOG_S)
        else:
            stack.enter_context(exclusive(where))
            host, port = parse_address(where)
            deadline_s, watchdog_s = data.daq.deadline_s, data.daq.watchdog_s
        bench = _node(host, port, deadline_s=deadline_s, watchdog_s=watchdog_s)
        stack.callback(bench.close)
        bench.take_session()
        yield bench


def stop_bench(profile: Profile | ProfileData, *, address: str | None = None) -> SafeState:
    """Make the bench at `address` safe, whoever holds it.

    Parameters
    ----------
    profile : Profile or ProfileData
        The bench.
    address : str, optional
        ``tcp://HOST:PORT``; default: that of the profile.

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
            fix="stop that command, or name the address tcp://HOST:PORT of a node",
        )
    host, port = parse_address(where)
    bench = _node(host, port, deadline_s=data.daq.deadline_s, watchdog_s=data.daq.watchdog_s)
    try:
        # a device that is no node is never written to
        bench.identity()
        return bench.safe_state()
    finally:
        bench.close()


def parse_address(address: str) -> tuple[str, int]:
    """Return host and port of ``tcp://HOST:PORT``.

    Parameters
    ----------
    address : str
        Address of a node.

    Returns
    -------
    tuple of str and int

    Raises
    ------
    UsageError
        If `address` has another form or the port is out of range.
    """
    scheme, _, rest = address.partition("://")
    host, _, port = rest.rpartition(":")
    if scheme != "tcp" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(
            f"{address!r} is no address of a bench; needed: embedded or tcp://HOST:PORT",
            where="address",
            fix="for example tcp://127.0.0.1:5020",
        )
    return host, int(port)


def _data(profile: Profile | ProfileData) -> ProfileData:
    return profile.data if isinstance(profile, Profile) else profile


def _node(host: str, port: int, *, deadline_s: float, watchdog_s: float) -> NodeBench:
    from hdbench.devices.node.driver import NodeBench
    from hdbench.devices.node.wire import NodeWire

    wire = NodeWire(host, port, deadline_s=deadline_s)
    return NodeBench(wire, watchdog_s=watchdog_s)
