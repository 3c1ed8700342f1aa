"""What is written on the film: what it is, and how to print and use it."""

from __future__ import annotations

from hdbench.gauges.film.request import FilmRequest

__all__ = ["small_print", "title"]


def title(request: FilmRequest) -> str:
    """Return the head line."""
    count = len(request.layout.rosettes)
    return f"Gauge placement film, {request.diameter_mm:g} mm flexspline, {count} rosettes"


def small_print(request: FilmRequest) -> tuple[str, ...]:
    """Return sizes and instructions, one line each."""
    geometry = request.geometry
    side = (
        "MIRRORED: gauges go on the PRINTED side, backs up; it then lies on the metal."
        if request.mirror
        else "Gauges go on the UNPRINTED side, backs up; this text reads right from outside."
    )
    reverse = [r for r in request.layout.rosettes if r.reverse]
    inner = ", ".join(f"R{r.gauges[r.reverse]}" for r in request.layout.rosettes)
    outer = ", ".join(f"R{r.gauges[not r.reverse]}" for r in request.layout.rosettes)
    turned = (
        f"; rosettes {', '.join(str(r.number) for r in reverse)} turned round" if reverse else ""
    )
    span = 2.0 * request.target_mm
    bench = f"{request.bench}: " if request.bench else ""
    return (
        f"{bench}boss {request.boss_mm:g}, rosettes on radius {geometry.radius_mm:g}, "
        f"grids {geometry.spacing_mm:g} apart, pad {request.pad_mm[0]:g} x {request.pad_mm[1]:g}, "
        f"grid {request.grid_mm[0]:g} x {request.grid_mm[1]:g} mm, lines {request.line_mm:g} mm",
        "1. Print at 100 % (actual size, no fit to page), finest resolution, on clear film.",
        "2. Measure BOTH bars. Use the film only if each is 100.0 mm within 0.1 mm.",
        f"    Targets are {span:.2f} mm apart along both edges: check their diagonals for skew.",
        f"3. {side}",
        "4. Under a microscope lay each pad on its outline; its centre marks on the radius and",
        "    on the short lines beside the pad. Grid axes are drawn through each grid.",
        f"    Inner grids: {inner}. Outer grids: {outer}{turned}.",
        "5. Scribe an index line on the flexspline. Lay the film on the clean, flat diaphragm:",
        "    outer ring on the rim, inner ring on the boss, 0 on the index line. Cement, press.",
        "6. Odd gauges lie at +45, even ones at -45 degrees to the radius (counter-clockwise, seen",
        "    from outside). If torque shows with the wrong sign, swap the two output wires.",
        "7. What a misplaced rosette does to gain, zero and ripple: hdbench gauge errors.",
    )
