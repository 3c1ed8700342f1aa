"""`hdbench diagnose`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench.errors import DoubtfulDataError, HdbenchError, LimitError, UsageError
from hdbench_cli.options import out_option, seed_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command", "show"]

_WORDS = {
    "nothing-found": "Nothing found: the simulation explains the measurement.",
    "named": "The simulation misses something, and it has a name.",
    "unexplained": "The simulation misses something that has no name yet.",
    "named-and-unexplained": "The simulation misses several things; not all have a name.",
    "data-bad": "The data do not allow a diagnosis.",
    "cannot-tell": "These data cannot tell.",
}
# effects listed with the smallest size that would have been found
_SHOWN_LIMITS = 4
# a false-alarm probability below this says no more than that there is an effect
_SURE = 1e-9


def show(console: Console, result: Mapping[str, Any]) -> None:
    """Draw a diagnosis on one screen."""
    console.print(_WORDS[result["verdict"]], style="bold", markup=False)
    if result["reason"]:
        console.print(result["reason"], markup=False)
    for cause in result["causes"]:
        _show_cause(console, cause)
    for place in result["unexplained"]:
        low, high = place["extent"]
        unit = "" if place["unit"] == "1" else f" {place['unit']}"
        console.print(
            f"unexplained at {place['domain']} {place['location']:.6g}{unit} "
            f"({low:.6g} to {high:.6g})\n"
            f"  {'size':<18}{place['size_nm']:.3g} N m, "
            f"{100.0 * place['share_of_variance']:.1f} % of the residual variance",
            markup=False,
        )
    small = [cause["name"] for cause in result["minor"]]
    if small:
        console.print(f"below the materiality line: {', '.join(small)}", markup=False)
    _show_gain(console, result)
    for flag in result["data_flags"]:
        console.print(
            f"flag      {flag['name']}: {flag['samples']} samples, "
            f"{flag['from_s']:.3f} to {flag['to_s']:.3f} s",
            markup=False,
        )


def _show_cause(console: Console, cause: Mapping[str, Any]) -> None:
    from rich.text import Text

    others = [name for name in (*cause["group"], *cause["rivals"]) if name != cause["name"]]
    head = Text(cause["name"], style="bold")
    if others:
        head.append(f"  (or {', '.join(others)})", style="not bold")
    console.print(head)
    for name, entry in cause["parameters"].items():
        if name.startswith(("cosine", "sine")) or entry["value"] is None:
            continue
        spread = "" if entry["std"] is None else f" +- {entry['std']:.2g}"
        unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
        console.print(f"  {name:<18}{entry['value']:.7g}{spread}{unit}", markup=False)
    gain = cause["gain"]
    low, high = gain["interval"]
    chance = cause["false_alarm_probability"]
    surely = f"below {_SURE:g}" if chance < _SURE else f"{chance:.1e}"
    console.print(
        f"  {'held-out residual':<18}{gain['heldout_rms_before_nm']:.4g} -> "
        f"{gain['heldout_rms_after_nm']:.4g} N m rms\n"
        f"  {'explained':<18}{100.0 * gain['explained_fraction']:.1f} % "
        f"({100.0 * low:.1f} to {100.0 * high:.1f} %), false alarm {surely}",
        markup=False,
    )
    if cause["separating_experiment"]:
        console.print(f"  told apart by: {cause['separating_experiment']}", markup=False)


def _show_gain(console: Console, result: Mapping[str, Any]) -> None:
    before = result["simulated"]["heldout_rms_nm"]
    after = result["extended"]["heldout_rms_nm"]
    if before is not None and after is not None:
        console.print(f"held-out  {before:.4g} N m rms simulated, {after:.4g} N m rms extended")
    limits = result["minimum_detectable"][:_SHOWN_LIMITS]
    if limits:
        console.print("would have been found with 90 %:", markup=False)
        for limit in limits:
            console.print(f"  {limit['name']:<28}{limit['amplitude_nm']:.2g} N m", markup=False)


def _list_causes(output: Output) -> None:
    from hdbench.diagnosis import describe_causes

    causes = describe_causes()

    def text(console: Console) -> None:
        for cause in causes:
            console.print(f"{cause['name']:<28}{cause['equation']}", markup=False, soft_wrap=True)

    output.result({"schema": "hdbench/causes/1", "causes": causes}, text)


@click.command("diagnose", epilog="Example: hdbench diagnose runs/RUN --check")
@click.argument(
    "sources", metavar="FILE_OR_RUN...", nargs=-1, type=click.Path(path_type=Path, exists=True)
)
@click.option(
    "--profile",
    "profile_name",
    metavar="NAME|PATH",
    help="Bench: a built-in name or a TOML file.  [default: the run's own, else cim-tr-97-06]",
)
@click.option(
    "--model",
    "model_file",
    metavar="FILE",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Bench model to hold against the data, such as an extended one; else the profile's.",
)
@out_option
@click.option(
    "--materiality",
    metavar="FRACTION",
    type=click.FloatRange(0.0, 1.0, max_open=True),
    default=0.01,
    show_default=True,
    help="Smallest share of the residual variance of a cause that counts.",
)
@click.option("--check", is_flag=True, help="Exit 3 unless nothing was found.")
@click.option("--list-causes", is_flag=True, help="Print the catalogue of causes.")
@seed_option
@click.pass_obj
def command(
    output: Output,
    sources: Sequence[Path],
    profile_name: str | None,
    model_file: Path | None,
    out: Path,
    materiality: float,
    check: bool,
    list_causes: bool,
    seed: int,
) -> None:
    """Show what the simulation gets wrong, name the cause, extend the model, measure the gain.

    Every input makes a run folder with the result, the extended model, the residual before and
    after, and its spectra.
    """
    if list_causes:
        _list_causes(output)
        return
    if not sources:
        raise UsageError(
            "nothing to diagnose",
            where="hdbench diagnose",
            fix="name a run folder, a trace or a loads file, or ask for --list-causes",
        )
    from hdbench.diagnosis import DiagnosisOptions, diagnose_run
    from hdbench_cli.experiment import choose_profile
    from hdbench_cli.progress import progress_bar

    options = DiagnosisOptions(model_file, materiality=materiality, seed=seed)
    done: list[tuple[Path, dict[str, Any]]] = []
    for source in sources:
        profile = choose_profile(profile_name, source)
        with progress_bar("diagnose") as progress:
            done.append(diagnose_run(source, profile, out=out, options=options, progress=progress))
    bodies = [{**result, "run_folder": str(folder)} for folder, result in done]
    whole = bodies[0] if len(bodies) == 1 else {"schema": "hdbench/list/1", "diagnoses": bodies}

    def text(console: Console) -> None:
        for body in bodies:
            show(console, body)
            console.print(f"\nrun       {body['run_folder']}", markup=False, soft_wrap=True)

    output.result(whole, text)
    _end(output, bodies, check)


def _end(output: Output, bodies: list[dict[str, Any]], check: bool) -> None:
    """End with the code of a failed check, or of doubtful data; the result is out already."""
    error: HdbenchError | None = None
    failed = [body for body in bodies if body["verdict"] != "nothing-found"]
    flagged = [body for body in bodies if body["data_flags"]]
    if check and failed:
        error = LimitError(
            f"verdict {failed[0]['verdict']}; needed: nothing-found",
            where=failed[0]["run_folder"],
            fix="look at the causes, or diagnose with --model and the extended model",
        )
    elif flagged:
        names = sorted({flag["name"] for flag in flagged[0]["data_flags"]})
        error = DoubtfulDataError(
            f"finished, but the data are doubtful: {', '.join(names)}",
            where=flagged[0]["run_folder"],
            fix="look at the marked samples, then measure again",
        )
    if error is None:
        return
    if output.json:
        output.note(str(error))
        raise click.exceptions.Exit(error.exit_code)
    raise error
