"""`hdbench gauge`: where the strain gauges go, and what a misplaced one does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from hdbench_cli.commands.gauge_errors import errors
from hdbench_cli.options import profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command"]

F = TypeVar("F", bound=Callable[..., Any])


@click.group(name="gauge", epilog="Example: hdbench gauge errors --circumferential 1")
def command() -> None:
    """Place the strain gauges on the flexspline, and see what misplacement does."""


command.add_command(errors)


def _length(name: str, text: str, default: float | None = None) -> Callable[[F], F]:
    shown = default is not None
    return click.option(
        name, metavar="MM", type=float, help=text, default=default, show_default=shown
    )


@command.command("film", epilog="Example: hdbench gauge film --boss 21 --out film.pdf")
@profile_option
@_length("--diameter", "Flexspline diameter.  [default: the profile's]")
@_length("--boss", "Boss or screw ring to stay clear of, diameter.  [default: 0.44 of --diameter]")
@_length("--radius", "Axis to centre of a rosette.  [default: midway between boss and rim]")
@_length("--pad-width", "Rosette pad along the circumference.", 6.0)
@_length("--pad-length", "Rosette pad along the radius.", 8.0)
@_length("--grid-length", "Measuring grid along its wires.", 1.5)
@_length("--grid-width", "Measuring grid across its wires.", 1.5)
@_length("--grid-spacing", "Between the centres of a rosette's two grids.", 3.6)
@_length("--line", "Line width; the finest that your printer holds.", 0.05)
@click.option(
    "--layout",
    type=click.Choice(["four", "two", "spread"]),
    default="four",
    show_default=True,
    help="Rosettes: four at 90 degrees (the report's), two at 90, or four at 45 degrees.",
)
@click.option(
    "--sheet",
    type=click.Choice(["a4", "letter", "a3"]),
    default="a4",
    show_default=True,
    help="Sheet of film.",
)
@click.option("--mirror", is_flag=True, help="For gauges laid on the printed side.")
@click.option(
    "--out",
    metavar="FILE.pdf",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("gauge-film.pdf"),
    show_default=True,
    help="PDF to write; the SVG goes beside it.",
)
@click.pass_obj
def film(
    output: Output,
    profile_name: str | None,
    diameter: float | None,
    boss: float | None,
    radius: float | None,
    pad_width: float,
    pad_length: float,
    grid_length: float,
    grid_width: float,
    grid_spacing: float,
    line: float,
    layout: str,
    sheet: str,
    mirror: bool,
    out: Path,
) -> None:
    """Draw the placement film for the flexspline's diaphragm at 1:1, as PDF and SVG.

    Rim, boss, radii, rosette pads, grids with their axes, a degree scale with index, registration
    targets, two bars of 100 mm. Print at 100 % on clear film and measure both bars.
    """
    from hdbench.gauges import GridGeometry, layout_named, usual_places
    from hdbench.gauges.film import FilmRequest, write_film
    from hdbench.records import result_header
    from hdbench_cli.commands.experiment import choose_profile

    profile = choose_profile(profile_name, None)
    across = profile.data.drive.flexspline_diameter_mm if diameter is None else diameter
    kept_clear, centre = usual_places(across, boss)
    request = FilmRequest(
        across,
        kept_clear,
        GridGeometry(centre if radius is None else radius, grid_spacing),
        (pad_width, pad_length),
        (grid_length, grid_width),
        layout_named(layout),
        sheet,
        mirror,
        line,
        profile.name,
    )
    made = write_film(request, out)
    if boss is None:
        output.note(f"boss not given: drawn with {kept_clear:g} mm; measure yours, give --boss")
    body = {**result_header("gauge-film", profile), **made.to_dict()}
    output.result(body, lambda console: _show(console, body))


def _show(console: Console, body: dict[str, Any]) -> None:
    lines = [body["title"]]
    lines += [f"  {name:27s} {size:8.3f} mm" for name, size in body["sizes_mm"].items()]
    lines += [f"{kind}  {path}" for kind, path in body["files"].items()]
    lines.append("next: print at 100 % on clear film, measure both bars; they must be 100.0 mm")
    for text in lines:
        console.print(text, markup=False, highlight=False, soft_wrap=True)
