"""`hdbench gauge`: where the strain gauges go, and what a misplaced one does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from hdbench_cli.inputs import choose_profile
from hdbench_cli.options import file_option, profile_option, seed_option
from hdbench_cli.output import Output
from hdbench_cli.text import table

if TYPE_CHECKING:
    from rich.console import RenderableType

    from hdbench.gauges import GaugedBench
    from hdbench.profile import Profile

F = TypeVar("F", bound=Callable[..., Any])
_SIZES = {
    "radial": ("radial_mm", "mm"),
    "circumferential": ("circumferential_deg", "deg"),
    "angular": ("angular_deg", "deg"),
    "off-centre": ("off_centre_mm", "mm"),
}
_HEADS = ("gain", "zero", "locked zero", "ripple 2x", "ripple 4x")
_NAMES = ("gain_change", "zero_nm", "locked_zero_nm", "ripple_2_nm", "ripple_4_nm")

layout_option = click.option(
    "--layout",
    type=click.Choice(["four", "two", "spread"]),
    default="four",
    help="Rosettes: four at 90 degrees (the report's), two at 90, or four at 45 degrees.",
)


def _number(name: str, unit: str, text: str, default: float | None = None) -> Callable[[F], F]:
    """Return an option that takes a number."""
    shown = default is not None
    return click.option(
        name, metavar=unit, type=float, help=text, default=default, show_default=shown
    )


@click.group(name="gauge", epilog="Example: hdbench gauge errors --circumferential 1")
def command() -> None:
    """Place the strain gauges on the flexspline, and see what misplacement does."""


@command.command("film", epilog="Example: hdbench gauge film --boss 21 --out film.pdf")
@profile_option
@_number("--diameter", "MM", "Flexspline diameter.  [default: the profile's]")
@_number(
    "--boss",
    "MM",
    "Diameter of the boss or screw ring to keep clear of.  [default: 0.44 of --diameter]",
)
@_number(
    "--radius", "MM", "Radius to the centre of a rosette.  [default: midway between boss and rim]"
)
@_number("--pad-width", "MM", "Rosette pad along the circumference.", 6.0)
@_number("--pad-length", "MM", "Rosette pad along the radius.", 8.0)
@_number("--grid-length", "MM", "Measuring grid along its wires.", 1.5)
@_number("--grid-width", "MM", "Measuring grid across its wires.", 1.5)
@_number("--grid-spacing", "MM", "Distance of a rosette's two grids, centre to centre.", 3.6)
@_number("--line", "MM", "Line width: the finest that your printer can draw.", 0.05)
@layout_option
@click.option(
    "--sheet",
    type=click.Choice(["a4", "letter", "a3"]),
    default="a4",
    help="Sheet of film.",
)
@click.option("--mirror", is_flag=True, help="For gauges laid on the printed side.")
@file_option(
    "--out",
    metavar="FILE.pdf",
    default=Path("gauge-film.pdf"),
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
    output.result(body, _film_lines)


def _film_lines(body: Mapping[str, Any]) -> Iterator[str]:
    yield body["title"]
    yield from (f"  {name:27s} {size:8.3f} mm" for name, size in body["sizes_mm"].items())
    yield from (f"{kind}  {path}" for kind, path in body["files"].items())
    yield "next: print at 100 % on clear film, measure both bars; they must be 100.0 mm"


@command.command(
    "errors", epilog="Example: hdbench gauge errors --circumferential 1 --csv errors.csv"
)
@profile_option
@layout_option
@_number("--radial", "MM", "Placement tolerance along the radius, +-.", 0.2)
@_number("--circumferential", "DEG", "Placement tolerance along the circumference, +-.", 1.0)
@_number("--angular", "DEG", "Turn of a rosette about its own centre, +-.", 1.0)
@_number("--off-centre", "MM", "Offset of the film from the axis, in any direction.", 0.2)
@click.option(
    "--distribution",
    type=click.Choice(["uniform", "normal"]),
    default="uniform",
    help="uniform: within the tolerance; normal: the tolerance is two standard deviations.",
)
@_number("--radius", "MM", "Radius to the centre of a rosette.  [default: midway, as the film]")
@_number("--grid-spacing", "MM", "Distance of a rosette's two grids, centre to centre.", 3.6)
@_number("--wave-strain", "STRAIN", "Strain of a pair at order 2.  [default: the profile's]")
@_number(
    "--wave-strain-4", "STRAIN", "Strain of a pair at order 4.  [default: from the model's ripple]"
)
@_number("--normal-share", "SHARE", "Ratio of normal to shear wave strain.", 1.0)
@_number("--assembly-strain", "STRAIN", "Steady radial strain of assembly.  [default: as order 2]")
@click.option("--draws", type=int, default=10_000, help="Simulated assemblies per row.")
@seed_option
@file_option("--csv", "csv_file", metavar="FILE.csv", help="The tables as CSV.")
@click.pass_obj
def errors(
    output: Output,
    profile_name: str | None,
    layout: str,
    radial: float,
    circumferential: float,
    angular: float,
    off_centre: float,
    distribution: Any,
    radius: float | None,
    grid_spacing: float,
    wave_strain: float | None,
    wave_strain_4: float | None,
    normal_share: float,
    assembly_strain: float | None,
    draws: int,
    seed: int,
    csv_file: Path | None,
) -> None:
    """Show what misplaced rosettes do to gain, zero and ripple.

    The exact bridge with the profile's gauge factor, supply, amplifier and gain; one rosette off at
    a time, then all of them by chance within the tolerance.
    """
    from hdbench.gauges import Tolerance, table_as_csv, tabulate_errors
    from hdbench.records import result_header, write_atomic

    profile = choose_profile(profile_name, None)
    bench = _bench(profile, layout, radius, grid_spacing)
    bench = _with_strain(bench, wave_strain, wave_strain_4, normal_share, assembly_strain)
    tolerance = Tolerance(radial, circumferential, angular, off_centre, distribution)
    table = tabulate_errors(bench, tolerance, draws=draws, seed=seed)
    body = {
        **result_header("gauge-errors", profile),
        "flexspline": profile.data.drive.flexspline,
        **table.to_dict(),
        "sentence": _sentence(table.to_dict()),
    }
    if csv_file is not None:
        write_atomic(csv_file, table_as_csv(table).encode())
        body["files"] = {"csv": str(csv_file)}
    output.result(body, _error_lines)


def _bench(profile: Profile, layout: str, radius: float | None, spacing: float) -> GaugedBench:
    from hdbench.gauges import GridGeometry, gauged_bench, layout_named, usual_places

    usual = usual_places(profile.data.drive.flexspline_diameter_mm)[1]
    geometry = GridGeometry(usual if radius is None else radius, spacing)
    return gauged_bench(profile.data, layout_named(layout), geometry)


def _with_strain(
    bench: GaugedBench,
    second: float | None,
    fourth: float | None,
    normal_share: float,
    assembly: float | None,
) -> GaugedBench:
    from hdbench.gauges import Wave

    known = {wave.order: wave.pair_strain for wave in bench.field.waves}
    strains = (
        known[2.0] if second is None else second,
        known[4.0] if fourth is None else fourth,
    )
    field = replace(
        bench.field,
        waves=(Wave(2.0, strains[0]), Wave(4.0, strains[1])),
        normal_share=normal_share,
        assembly_strain=strains[0] if assembly is None else assembly,
    )
    return replace(bench, field=field)


def _sentence(body: dict[str, Any]) -> str:
    """Say what the circumferential tolerance does, in one line."""
    size = body["tolerance"]["circumferential_deg"]
    one = max(
        r["effects"]["ripple_2_nm"] for r in body["one_off"] if r["kind"] == "circumferential"
    )
    row = next(r for r in body["scatter"] if r["kind"] == "circumferential")
    by_share = {q["share"]: q["value"] for q in row["effects"]["ripple_2_nm"]}
    return (
        f"With {size:g} degree circumferential you will see {one:.3g} N m of ripple at twice "
        f"wave-generator speed if one rosette is off, and at most {by_share[0.95]:.3g} N m in 95 "
        f"of 100 assemblies with all of them off by chance (half: at most {by_share[0.5]:.3g} N m)."
    )


def _error_lines(body: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Yield the tables of `hdbench gauge errors`."""
    from rich.text import Text

    yield from _cancelling(body)
    yield ""
    yield _one_off(body)
    yield ""
    yield _scatter(body)
    drawn = f"{body['draws']} draws, {body['tolerance']['distribution']}, seed {body['seed']}"
    yield Text(f"N m; {drawn}", style="dim")
    yield f"\n{body['sentence']}"
    if body["flexspline"] == "turning":
        yield (
            "The flexspline turns: an order counts wave-generator turns against it, "
            "(1 + 1/N) of them in a motor turn."
        )
    yield from (f"{name}  {path}" for name, path in body.get("files", {}).items())


def _cancelling(body: Mapping[str, Any]) -> Iterator[str]:
    """Yield which orders the layout cancels, and why."""
    angles = [r["angle_deg"] for r in body["layout"]["rosettes"]]
    yield f"{body['layout']['words']}, on radius {body['layout']['radius_mm']:g} mm"
    for wave in body["uncancelled_nm"]:
        phases = ", ".join(f"{math.fmod(wave['order'] * angle, 360.0):g}" for angle in angles)
        left = wave["left_by_layout"]
        # 1e-9: rounding of the phasors' sum
        end = "they cancel" if left < 1e-9 else f"{100 * left:.0f} % of it stays"
        yield (
            f"  order {wave['order']:g}: {wave['amplitude_nm']:.3g} N m uncancelled; the rosettes "
            f"see it at {phases} degrees: {end}"
        )
    if body["layout"]["name"] == "spread":
        yield "  order 2 turns by 90 degrees from one rosette to the next, order 4 by 180"
        return
    yield (
        "  order 2 turns by 180 degrees from one rosette to the next, order 4 by 360: only "
        "rosettes 45 degrees apart cancel both (--layout spread)"
    )


def _cells(values: list[float]) -> list[str]:
    gain, *torques = values
    return [f"{100 * gain:.3f} %", *(f"{t:.4f}" if abs(t) >= 5e-5 else "0" for t in torques)]


def _one_off(body: Mapping[str, Any]) -> RenderableType:
    rows = [["nothing", "all", *_cells([body["in_place"][name] for name in _NAMES]), ""]]
    merged: dict[tuple[str, ...], list[str]] = {}
    for row in body["one_off"]:
        name, unit = _SIZES[row["kind"]]
        closed = row["closed_form_2_nm"]
        key = (
            f"{body['tolerance'][name]:g} {unit} {row['kind']}",
            *_cells([row["effects"][name] for name in _NAMES]),
            "" if closed is None else f"{closed:.4f}",
        )
        merged.setdefault(key, []).append(str(row["rosette"] or "film"))
    rows += [[key[0], ", ".join(numbers), *key[1:]] for key, numbers in merged.items()]
    return table(("one rosette off by", "which", *_HEADS, "closed 2x"), rows)


def _scatter(body: Mapping[str, Any]) -> RenderableType:
    rows = []
    for row in body["scatter"]:
        for index in (0, 2):
            found = [row["effects"][name][index] for name in _NAMES]
            share = f"{100 * found[0]['share']:.0f} below"
            cells = _cells([q["value"] for q in found])
            rows.append([row["kind"] if index == 0 else "", share, *cells])
    return table(("all off by chance", "of 100", *_HEADS), rows)
