"""`hdbench export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench.errors import UsageError
from hdbench_cli.options import profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command"]


@click.command("export", epilog="Example: hdbench export --model report-6 --out firmware")
@click.option(
    "--model",
    "filter_name",
    metavar="NAME|FILE",
    help="Write this filter as C99 firmware: report-a1, report-a2, report-6 or a model file.",
)
@click.option(
    "--out",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder to write.",
)
@click.option(
    "--period",
    "period_s",
    metavar="S",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Sampling period of the firmware.  [default: the profile's]",
)
@profile_option
@click.pass_obj
def command(
    output: Output,
    filter_name: str | None,
    out: Path,
    period_s: float | None,
    profile_name: str | None,
) -> None:
    """Write a filter model as C99 source for a controller.

    The same source as the host's filter, with the model's numbers, an example for an interrupt,
    test vectors and a self-test.
    """
    from hdbench.filter.firmware import export_firmware
    from hdbench.records import result_header
    from hdbench.session.filters import choose_filter
    from hdbench_cli.experiment import choose_profile

    if filter_name is None:
        raise UsageError(
            "nothing to export was named", where="hdbench export", fix="give --model NAME|FILE"
        )
    profile = choose_profile(profile_name, None)
    model = choose_filter(profile, filter_name)
    period = period_s or profile.data.daq.sample_period_s
    files = export_firmware(model, out, sample_period_s=period, source=filter_name)
    body = {
        **result_header("export", profile),
        "folder": str(out),
        "sample_period_s": period,
        "files": files,
        "filter": model.to_dict(),
    }
    output.result(body, lambda console: _show(console, body))


def _show(console: Console, body: dict[str, Any]) -> None:
    console.print(
        f"{len(body['files'])} files in {body['folder']}; `make` there runs the self-test",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
