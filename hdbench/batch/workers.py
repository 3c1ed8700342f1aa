"""Worker processes on dask.distributed: start them or find them, and run tasks until all are told.

One task at a time runs in a process: the commands share process-wide state (figures, warnings).
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import islice
from types import ModuleType
from typing import Any

from hdbench.errors import DeviceError, UsageError
from hdbench.system.processes import kill, undisturbed

# so long without a single worker, s, nobody will come: a loaded computer starts one in 30
_WITHOUT_WORKERS_S = 120.0
_LOOK_S = 0.5
# a value is a row of a table: it is here at once, or its worker is gone
_FETCH_S = 10.0
_CLOSE_S = 10
_STOPS = ("SIGINT", "SIGTERM", "SIGHUP")
_ONE_AT_A_TIME = threading.Lock()
_CONFIG = {
    # the client counts the deaths of a worker, so that --retries means what it says
    "distributed.scheduler.allowed-failures": 0,
    # a task waits at the scheduler, not at a worker that another task may kill
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.scheduler.work-stealing": False,
    # nothing is kept in a worker between tasks: too much memory ends it, and never pauses it
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    # handing every large array back to the system at once costs as much as the work itself
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    "distributed.worker.profile.enabled": False,
    "distributed.logging.distributed": "critical",
    "distributed.admin.log-format": "%(message)s",
}


@dataclass(frozen=True, slots=True)
class Workers:
    """Where tasks run.

    Parameters
    ----------
    count : int
        Processes of a cluster on this computer, started for the purpose.
    scheduler : str or None
        Address of an existing scheduler instead, such as ``tcp://HOST:8786``.
    retries : int
        How often a task runs again after its worker died.
    memory : str
        Most that one worker may hold, such as ``2GB``; ``auto`` shares this computer's memory
        among the workers. An existing scheduler's workers have limits of their own.
    """

    count: int = 1
    scheduler: str | None = None
    retries: int = 2
    memory: str = "auto"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one task.

    Parameters
    ----------
    task : object
        As it was given.
    value : object
        What the function returned; None where the worker died.
    deaths : int
        How many workers died while they held it.
    lost : bool
        Whether it was given up: more deaths than retries.
    """

    task: Any
    value: Any = None
    deaths: int = 0
    lost: bool = False


def require_batch() -> None:
    """Name the extra that brings what a batch needs where that is not installed."""
    missing = [name for name in ("distributed", "pyarrow") if find_spec(name) is None]
    if missing:
        raise UsageError(
            f"not installed: {', '.join(missing)}; needed to run over many inputs",
            where="hdbench batch",
            fix="pip install 'hdbench[batch]'",
        )


def run_tasks(
    function: Callable[[Any], Any], tasks: Iterable[Any], workers: Workers
) -> Generator[Outcome, None, None]:
    """Run a function over tasks and yield what came out, in the order of coming.

    Parameters
    ----------
    function : callable
        Takes one task. It must be importable by the workers, and is called once more with the
        same task where a worker died: doing it twice must do no harm.
    tasks : iterable
        Taken one by one as workers become free, so that there may be very many.
    workers : Workers
        Where they run.

    Yields
    ------
    Outcome
        One for each task.

    Raises
    ------
    UsageError
        If dask.distributed is not installed, or the workers have another version of hdbench.
    DeviceError
        If the scheduler cannot be reached, is lost, or has no worker.
    Exception
        Whatever `function` raises.

    Notes
    -----
    Closing the generator, Ctrl-C too, stops a local cluster with what it is doing.
    """
    require_batch()
    import dask
    import distributed

    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_CONFIG))
        client = stack.enter_context(_client(distributed, workers))
        try:
            yield from _run(distributed, client, function, iter(tasks), workers)
        except OSError as error:
            if workers.scheduler is None:
                raise
            raise _scheduler_lost(workers.scheduler, str(error)) from error


def _run(
    distributed: ModuleType,
    client: Any,
    function: Callable[[Any], Any],
    tasks: Iterator[Any],
    workers: Workers,
) -> Iterator[Outcome]:
    held: dict[Any, Outcome] = {}
    seats = _Seats(client, workers)

    def start(task: Any, deaths: int) -> None:
        future = client.submit(_alone, function, task, pure=False)
        held[future] = Outcome(task, deaths=deaths)

    def fill() -> None:
        # one waits at the scheduler, so that no worker waits for us
        for task in islice(tasks, max(0, seats.count() + 1 - len(held))):
            start(task, 0)

    fill()
    while held:
        try:
            ended = distributed.wait(list(held), timeout=_LOOK_S, return_when="FIRST_COMPLETED")
        except TimeoutError:
            seats.check()
            continue
        for future in ended.done:
            entry, status = held[future], future.status
            if status == "finished":
                try:
                    outcome = replace(entry, value=future.result(timeout=_FETCH_S))
                except (TimeoutError, distributed.KilledWorker):
                    status = "lost"
            if status in ("lost", "pending"):
                # its worker died before the value was here: the scheduler computes it again
                seats.check()
                continue
            error = future.exception() if status == "error" else None
            del held[future]
            if status == "finished":
                yield outcome
            elif isinstance(error, distributed.KilledWorker):
                deaths = entry.deaths + 1
                if deaths > workers.retries:
                    yield replace(entry, deaths=deaths, lost=True)
                else:
                    start(entry.task, deaths)
            elif error is not None:
                raise error
            else:
                raise _scheduler_lost(workers.scheduler or "local cluster", status)
            future.release()
        fill()


class _Seats:
    """How many workers there are now; an existing cluster may grow and shrink."""

    def __init__(self, client: Any, workers: Workers) -> None:
        self._client = client
        self._workers = workers
        self._count = 1
        self._asked_s = float("-inf")
        self._seen_s = time.monotonic()

    def count(self) -> int:
        now_s = time.monotonic()
        if now_s - self._asked_s > _LOOK_S:
            self._asked_s = now_s
            found = len(self._client.nthreads())
            if found:
                self._seen_s = now_s
            self._count = max(found, 1)
            if self._workers.scheduler is None and found < self._workers.count:
                _mend(self._client.cluster, self._workers.count)
        return self._count

    def check(self) -> None:
        """End where nobody has been there to work for a while."""
        self.count()
        where = self._workers.scheduler or "local cluster"
        if self._client.status != "running":
            raise _scheduler_lost(where, self._client.status)
        if time.monotonic() - self._seen_s > _WITHOUT_WORKERS_S:
            raise DeviceError(
                f"no worker for {_WITHOUT_WORKERS_S:.0f} s",
                where=where,
                fix="start workers (dask worker ADDRESS), then go on with --resume",
            )


def _alone(function: Callable[[Any], Any], task: Any) -> Any:
    with _ONE_AT_A_TIME:
        return function(task)


@contextmanager
def _client(distributed: ModuleType, workers: Workers) -> Iterator[Any]:
    if workers.scheduler is None:
        with _local_cluster(distributed, workers) as cluster:
            client = distributed.Client(cluster)
            try:
                yield client
            finally:
                # a cluster that is stopped while it starts cancels what it waits for
                with undisturbed(*_STOPS), suppress(Exception):
                    client.close(timeout=_CLOSE_S)
        return
    try:
        client = distributed.Client(workers.scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise DeviceError(
            f"the scheduler cannot be reached: {error}",
            where=workers.scheduler,
            fix="start one (dask scheduler), or leave --scheduler out for a cluster on this "
            "computer",
        ) from error
    try:
        _check_versions(client, workers.scheduler)
        yield client
    finally:
        client.close()


@contextmanager
def _local_cluster(distributed: ModuleType, workers: Workers) -> Iterator[Any]:
    from dask.utils import parse_bytes

    memory = workers.memory
    try:
        limit = "auto" if memory == "auto" else parse_bytes(memory)
    except ValueError as error:
        raise UsageError(
            f"{memory!r} is no size", where="--memory", fix="give it such as 2GB"
        ) from error
    with _quiet_logs(), _loop_without_ctrl_c() as loop:
        # only this computer can reach it
        with undisturbed(*_STOPS):
            cluster = distributed.LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                memory_limit=limit,
                silence_logs=logging.CRITICAL,
                loop=loop,
            )
        try:
            _mend(cluster, workers.count)
            yield cluster
        finally:
            with undisturbed(*_STOPS):
                _close(cluster)


def _close(cluster: Any) -> None:
    """Stop a cluster; what a loaded computer does not stop in time is killed: nothing is in it."""
    try:
        cluster.close(timeout=_CLOSE_S)
    except Exception:  # noqa: BLE001 - it is stopped while it starts, or too slow: kill it
        for nanny in list(cluster.workers.values()):
            with suppress(OSError, TypeError):
                kill(nanny.pid)


def _mend(cluster: Any, count: int) -> None:
    """Start the workers that there should be; one that died while it started is not kept."""

    def mend() -> None:
        for name, nanny in list(cluster.workers.items()):
            if nanny.status.name in ("failed", "closed"):
                del cluster.workers[name]
        cluster.scale(count)

    cluster.loop.add_callback(mend)


@contextmanager
def _quiet_logs() -> Iterator[None]:
    """Keep to ourselves that workers died: the batch counts it, and says so where it matters."""
    loggers = [logging.getLogger(name) for name in ("asyncio", "distributed", "tornado")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


@contextmanager
def _loop_without_ctrl_c() -> Iterator[Any]:
    """Run the event loop in a thread that blocks Ctrl-C; the processes that it starts inherit that.

    A terminal sends it to all of them, and it is for the client, which then stops the workers.
    """
    from multiprocessing import resource_tracker

    from distributed.utils import LoopRunner

    # it unblocks the signal in the thread that starts it: that must not be the loop's
    resource_tracker.ensure_running()
    runner: Any = LoopRunner()
    with undisturbed("SIGINT"):
        runner.start()
    try:
        yield runner.loop
    finally:
        runner.stop()


def _version(**_: Any) -> str:
    from hdbench import __version__

    return __version__


def _check_versions(client: Any, scheduler: str) -> None:
    """Refuse workers of another version: their results would not be ours."""
    found = client.run(_version, on_error="return")
    wrong = {
        address: told if isinstance(told, str) else f"none ({told})"
        for address, told in found.items()
        if told != _version()
    }
    if wrong:
        address, told = next(iter(wrong.items()))
        raise UsageError(
            f"{len(wrong)} of {len(found)} workers have another hdbench, such as {address}: "
            f"{told}; needed: {_version()}",
            where=scheduler,
            fix=f"install hdbench {_version()} where the workers run",
        )


def _scheduler_lost(scheduler: str, detail: str) -> DeviceError:
    return DeviceError(
        f"the scheduler was lost: {detail}",
        where=scheduler,
        fix="start it again, then go on with --resume: what is done is kept",
    )
