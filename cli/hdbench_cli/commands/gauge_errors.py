"""`hdbench gauge errors`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.commands.gauge_table import show_errors
from hdbench_cli.options import profile_option, seed_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from hdbench.gauges import GaugedBench
    from hdbench.profile import Profile

__all__ = ["errors"]


@click.command(
    "errors", epilog="Example: hdbench gauge errors --circumferential 1 --csv errors.csv"
)
@profile_option
@click.option(
    "--layout",
    type=click.Choice(["four", "two", "spread"]),
    default="four",
    show_default=True,
    help="Rosettes: four at 90 degrees (the report's), two at 90, or four at 45 degrees.",
)
@click.option("--radial", metavar="MM", type=float, default=0.2, show_default=True,
              help="Placement tolerance along the radius, +-.")  # fmt: skip
@click.option("--circumferential", metavar="DEG", type=float, default=1.0, show_default=True,
              help="Placement tolerance along the circumference, +-.")  # fmt: skip
@click.option("--angular", metavar="DEG", type=float, default=1.0, show_default=True,
              help="Turn of a rosette about its own centre, +-.")  # fmt: skip
@click.option(
    "--off-centre",
    metavar="MM",
    type=float,
    default=0.2,
    show_default=True,
    help="The film with all rosettes, from the axis, in any direction.",
)
@click.option(
    "--distribution",
    type=click.Choice(["uniform", "normal"]),
    default="uniform",
    show_default=True,
    help="Within the tolerance, or the tolerance as two standard deviations.",
)
@click.option("--radius", metavar="MM", type=float,
              help="Axis to centre of a rosette.  [default: midway, as the film]")  # fmt: skip
@click.option("--grid-spacing", metavar="MM", type=float, default=3.6, show_default=True,
              help="Between the centres of a rosette's two grids.")  # fmt: skip
@click.option("--wave-strain", metavar="STRAIN", type=float,
              help="Strain of a pair at order 2.  [default: the profile's]")  # fmt: skip
@click.option("--wave-strain-4", metavar="STRAIN", type=float,
              help="The same at order 4.  [default: from the model's ripple]")  # fmt: skip
@click.option("--normal-share", metavar="SHARE", type=float, default=1.0, show_default=True,
              help="Normal over shear amplitude of the wave strain.")  # fmt: skip
@click.option("--assembly-strain", metavar="STRAIN", type=float,
              help="Steady radial strain of assembly.  [default: as order 2]")  # fmt: skip
@click.option("--draws", type=int, default=10_000, show_default=True,
              help="Assemblies drawn per row.")  # fmt: skip
@seed_option
@click.option("--csv", "csv_file", metavar="FILE.csv", help="The tables as CSV.",
              type=click.Path(path_type=Path, dir_okay=False))  # fmt: skip
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
    from hdbench_cli.commands.experiment import choose_profile

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
    output.result(body, lambda console: show_errors(console, body))


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
    from dataclasses import replace

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
