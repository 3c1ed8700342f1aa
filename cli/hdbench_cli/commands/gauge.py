"""`hdbench gauge`: where the strain gauges go, and what a misplaced one does."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hdbench.gauges import (
    LAYOUTS,
    GridGeometry,
    Tolerance,
    gauged_bench,
    table_as_csv,
    tabulate_errors,
    usual_places,
)
from hdbench.gauges.film import FilmRequest, write_film
from hdbench.records import write_atomic
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output
from hdbench_cli.text import Line, Lines, styled, table

_SIZES = {
    "radial": ("radial_mm", "mm"),
    "circumferential": ("circumferential_deg", "deg"),
    "angular": ("angular_deg", "deg"),
    "off-centre": ("off_centre_mm", "mm"),
}
_STRAIN = ("wave_strain", "wave_strain_4", "normal_share", "assembly_strain")
_TOLERANCE = ("radial", "circumferential", "angular", "off_centre", "distribution")
_HEADS = ("gain", "zero", "locked zero", "ripple 2x", "ripple 4x")
_NAMES = ("gain_change", "zero_nm", "locked_zero_nm", "ripple_2_nm", "ripple_4_nm")


def film_command(
    output: Output, profile_name: str | None, layout: str, out: Path, **asked: Any
) -> None:
    """Draw the placement film for the flexspline's diaphragm at 1:1, as PDF and SVG."""
    profile = choose_profile(profile_name, None)
    diameter = asked["diameter"]
    across = profile.data.drive.flexspline_diameter_mm if diameter is None else diameter
    kept_clear, centre = usual_places(across, asked["boss"])
    radius = centre if asked["radius"] is None else asked["radius"]
    request = FilmRequest(
        across,
        kept_clear,
        GridGeometry(radius, asked["grid_spacing"]),
        (asked["pad_width"], asked["pad_length"]),
        (asked["grid_length"], asked["grid_width"]),
        LAYOUTS[layout],
        asked["sheet"],
        asked["mirror"],
        asked["line"],
        profile.name,
    )
    made = write_film(request, out)
    if asked["boss"] is None:
        output.note(f"boss not given: drawn with {kept_clear:g} mm; measure yours, give --boss")
    body = made.to_dict()
    output.result(body, _film_lines(body), kind="gauge-film", profile=profile)


def _film_lines(body: Mapping[str, Any]) -> Iterator[str]:
    yield body["title"]
    yield from (f"  {name:27s} {size:8.3f} mm" for name, size in body["sizes_mm"].items())
    yield from (f"{kind}  {path}" for kind, path in body["files"].items())
    yield "next: print at 100 % on clear film, measure both bars; they must be 100.0 mm"


def errors_command(
    output: Output, profile_name: str | None, layout: str, csv_file: Path | None, **asked: Any
) -> None:
    """Show what misplaced rosettes do to gain, zero and ripple."""
    profile = choose_profile(profile_name, None)
    usual = usual_places(profile.data.drive.flexspline_diameter_mm)[1]
    radius = usual if asked["radius"] is None else asked["radius"]
    geometry = GridGeometry(radius, asked["grid_spacing"])
    strain = (asked[name] for name in _STRAIN)
    bench = gauged_bench(profile.data, LAYOUTS[layout], geometry).with_strain(*strain)
    tolerance = Tolerance(*(asked[name] for name in _TOLERANCE))
    found = tabulate_errors(bench, tolerance, draws=asked["draws"], seed=asked["seed"])
    told = found.to_dict()
    flexspline = profile.data.drive.flexspline
    body = {"flexspline": flexspline, **told, "sentence": _sentence(told)}
    if csv_file is not None:
        write_atomic(csv_file, table_as_csv(found).encode())
        body["files"] = {"csv": str(csv_file)}
    output.result(body, _error_lines(body), kind="gauge-errors", profile=profile)


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


def _error_lines(body: Mapping[str, Any]) -> Lines:
    """Yield the tables of `hdbench gauge errors`."""
    yield from _cancelling(body)
    yield ""
    yield _one_off(body)
    yield ""
    yield _scatter(body)
    drawn = f"{body['draws']} draws, {body['tolerance']['distribution']}, seed {body['seed']}"
    yield styled((f"N m; {drawn}", "dim"))
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


def _one_off(body: Mapping[str, Any]) -> Line:
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


def _scatter(body: Mapping[str, Any]) -> Line:
    rows = []
    for row in body["scatter"]:
        for index in (0, 2):
            found = [row["effects"][name][index] for name in _NAMES]
            share = f"{100 * found[0]['share']:.0f} below"
            cells = _cells([q["value"] for q in found])
            rows.append([row["kind"] if index == 0 else "", share, *cells])
    return table(("all off by chance", "of 100", *_HEADS), rows)
