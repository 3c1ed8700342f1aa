"""The command group: commands are imported when they are called, errors end here."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

import click

from hdbench.errors import HdbenchError, StorageError, UsageError
from hdbench_cli.output import Output
from hdbench_cli.signals import end_by_signals

_COMMANDS: dict[str, tuple[str, str]] = {
    "calibrate": ("calibrate", "Arm-and-weight calibration with locked wave generator."),
    "run-misalignment": ("run_misalignment", "Constant-velocity run: torque once per output turn."),
    "run-ripple": ("run_ripple", "Free-motion run: torque ripple at 2x and 4x motor speed."),
    "filter": ("filter", "Remove ripple and misalignment from a stored trace."),
    "tune": ("tune", "Fit the noise parameters of the filter to traces."),
    "response": ("response", "Show what a filter model does to the torque."),
    "export": ("export", "Write a filter as C99 source, or runs as Parquet, HDF5 or MATLAB."),
    "orders": ("orders", "Compute order spectrum, order map, and every order over time."),
    "diagnose": ("diagnose", "Show what the simulation gets wrong and name the cause."),
    "plan": ("plan", "Propose the run that separates causes; write it as a plan file."),
    "simulate": ("simulate", "Compute the bench model, alone or on a measured motion."),
    "emulate": ("emulate", "Serve the emulated bench over Modbus TCP."),
    "report": ("report", "Write runs as one offline HTML file with CSV and JSON."),
    "inspect": ("inspect", "Check what a log can show, and what it cannot."),
    "regress": ("regress", "Re-evaluate stored traces and compare with stored results."),
    "import": ("import_", "Import traces and loads from other programs."),
    "batch": ("batch", "Run a command over many inputs; one table of all."),
    "runs": ("runs", "List, show, verify, resume and compare runs."),
    "trend": ("trend", "Follow a quantity over many runs: control charts, steps, drift."),
    "gauge": ("gauge", "Draw the film that places strain gauges; compute their placement errors."),
    "profile": ("profile", "List, show, check and make profiles."),
    "stop": ("stop", "Stop the motor of a bench now, whoever runs it."),
    "monitor": ("monitor", "Watch a bench live; nothing moves, nothing is stored."),
    "devices": ("devices", "List the serial ports and the devices on them."),
    "doctor": ("doctor", "Check this installation and the bench."),
    "completion": ("completion", "Print the script that completes commands in a shell."),
    "demo": ("demo", "Run the whole bench in a minute, without hardware."),
}


def _set_json(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value:
        ctx.ensure_object(Output).json = True


def _add_verbose(ctx: click.Context, _param: click.Parameter, value: int) -> None:
    ctx.ensure_object(Output).verbose += value


def _shared_options() -> list[click.Parameter]:
    return [
        click.Option(
            ["--json"],
            is_flag=True,
            expose_value=False,
            callback=_set_json,
            help="Print exactly one JSON object on stdout.",
        ),
        click.Option(
            ["-v", "--verbose"],
            count=True,
            show_default=False,
            expose_value=False,
            callback=_add_verbose,
            help="Print more; for a bug, print its traceback.",
        ),
    ]


def _with_shared_options(command: click.Command) -> click.Command:
    names = {name for param in command.params for name in param.opts}
    command.params.extend(o for o in _shared_options() if not names & set(o.opts))
    if isinstance(command, click.Group):
        for child in command.commands.values():
            _with_shared_options(child)
    return command


class _LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the command names in the order of the bench's work."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command."""
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"hdbench_cli.commands.{_COMMANDS[cmd_name][0]}")
        command: click.Command = module.command
        return _with_shared_options(command)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        rows = [(name, summary) for name, (_, summary) in _COMMANDS.items()]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Name the nearest command when one is mistyped."""
        name = args[0]
        if name not in _COMMANDS:
            import difflib

            near = difflib.get_close_matches(name, _COMMANDS, n=1)
            hint = f" Did you mean '{near[0]}'?" if near else " See 'hdbench --help'."
            ctx.fail(f"No such command '{name}'.{hint}")
        return super().resolve_command(ctx, args)


def _show_version(output: Output) -> None:
    from hdbench import __version__

    if not (output.json or output.verbose):
        click.echo(f"hdbench {__version__}")
        return
    from hdbench_cli.commands.doctor import version_facts

    output.result(version_facts(), lambda facts: [f"{k} {v}" for k, v in facts.items()])


@click.group(
    cls=_LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    epilog="First time here? Run `hdbench demo`.",
    params=[
        *_shared_options(),
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
