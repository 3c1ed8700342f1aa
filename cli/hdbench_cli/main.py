"""The program: errors of commands, and signals, become exit codes here."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

import click

from hdbench.errors import HdbenchError, StorageError, UsageError
from hdbench_cli.commandline import CommandGroup, shared_options
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

# a moment later the program is somewhere else
_AGAIN_S = 0.01


def end_by_signals() -> None:
    """End on SIGTERM and SIGHUP with 128 and their number, and never lose one or a Ctrl-C."""
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _end)
    sys.unraisablehook = _send_again


def _end(signum: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + signum)


def _send_again(lost: UnraisableHookArgs) -> None:
    """Send a signal once more that came where nothing can be raised: while objects are cleared."""
    error = lost.exc_value
    signum = getattr(error, "signum", None)
    if isinstance(error, KeyboardInterrupt):
        signum = signal.SIGINT
    elif isinstance(error, SystemExit) and isinstance(error.code, int):
        signum = error.code - 128
    if not isinstance(signum, int) or not signum > 0:
        sys.__unraisablehook__(lost)
        return
    from threading import Thread

    Thread(target=_when_back, args=(signum,), daemon=True).start()


def _when_back(signum: int) -> None:
    """Send a signal once the main thread has left `_send_again`, which would lose it, too."""
    import time
    from threading import main_thread

    from hdbench.system.processes import signal_self

    is_there = True
    while is_there:
        time.sleep(_AGAIN_S)
        frame = sys._current_frames().get(main_thread().ident or 0)  # noqa: SLF001 - no other way
        while frame is not None and frame.f_code is not _send_again.__code__:
            frame = frame.f_back
        is_there = frame is not None
    signal_self(signum)


def _show_version(output: Output) -> None:
    from hdbench import __version__

    if not (output.json or output.verbose):
        click.echo(f"hdbench {__version__}")
        return
    from hdbench_cli.commands.doctor import version_facts

    facts = version_facts()
    output.result(facts, [f"{name} {value}" for name, value in facts.items()])


@click.group(
    name="",
    cls=CommandGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    epilog="First time here? Run `hdbench demo`.",
    params=[
        *shared_options(),
        click.Option(
            ["--version"],
            is_flag=True,
            help="Show the version; with -v the kernel and libraries too.",
        ),
    ],
)
@click.pass_context
def cli(ctx: click.Context, version: bool) -> None:
    """Drive the bench of a harmonic drive with a built-in torque sensor.

    Calibrate the sensor, measure misalignment and ripple, filter them out of the torque, and find
    what the simulation does not yet know. Everything runs without hardware on an embedded bench.
    """
    if version:
        _show_version(ctx.ensure_object(Output))
    elif ctx.invoked_subcommand is None:
        if ctx.ensure_object(Output).json:
            ctx.fail("Missing command.")
        click.echo(ctx.get_help())


def _fail(output: Output, error: HdbenchError) -> int:
    # a terminal that was closed hears nothing; the exit code still tells
    with suppress(OSError):
        output.error(error)
    return error.exit_code


def _usage(error: click.ClickException, output: Output) -> int:
    command = getattr(getattr(error, "ctx", None), "command_path", "hdbench")
    message = error.format_message()
    fix = f"run '{command} --help' and correct the call"
    if message.endswith("is not readable."):
        fix = "ask for the right to read it, or name a copy that you may read"
    wrapped = UsageError(message, where=command, fix=fix)
    wrapped.exit_code = error.exit_code
    return _fail(output, wrapped)


def _run(arguments: Sequence[str], output: Output) -> int:
    """Run one command line and return its exit code; nothing is raised."""
    try:
        code: Any = cli.main(
            list(arguments), prog_name="hdbench", standalone_mode=False, obj=output
        )
    except HdbenchError as error:
        return _fail(output, error)
    except click.exceptions.Exit as stop:
        return stop.exit_code
    except (click.Abort, KeyboardInterrupt):
        output.note("stopped")
        return 130
    except click.ClickException as error:
        return _usage(error, output)
    except BrokenPipeError:
        return 0  # the reader of our stdout has gone; nothing is left to be told
    except OSError as error:
        return _fail(
            output,
            StorageError(
                f"{error.strerror or error}",
                where=str(error.filename or "file system"),
                fix="check path, rights and free space",
            ),
        )
    except Exception as error:  # noqa: BLE001 - the one boundary where a bug becomes an exit code
        if output.verbose:
            traceback.print_exc()
        return _fail(
            output,
            HdbenchError(
                f"{type(error).__name__}: {error}",
                where="hdbench",
                fix="this is a bug: run again with -v and send us what it prints",
            ),
        )
    return code if isinstance(code, int) else 0


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with the contract's code."""
    # our matrices are tall and narrow: BLAS threads only wait for each other, at 2.5 times the CPU
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    end_by_signals()
    words = sys.argv[1:] if arguments is None else list(arguments)
    if not sys.warnoptions and "-v" not in words:
        import warnings

        # a library's remark on its own line of code; what it leads to is told as a doubt or error
        warnings.simplefilter("ignore", RuntimeWarning)
    output = Output(json="--json" in words)
    try:
        code = _run(words, output)
    except KeyboardInterrupt:  # one more Ctrl-C while the first one's end was being told
        code = 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the exit code is decided
    _flush()
    sys.exit(code)


def _flush() -> None:
    """Write what is buffered: a terminal or reader that has gone must not change the exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    main()
