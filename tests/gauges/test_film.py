"""The film: sizes of both files measured by tools of others, refusals, nothing half written."""

import dataclasses
import io
import math
import re
from xml.etree import ElementTree

import pytest
from pypdf import PdfReader

from hdbench.errors import UsageError
from hdbench.gauges import LAYOUTS, GridGeometry
from hdbench.gauges.film import SHEETS, FilmRequest, write_film

# laser printers place to 0.04 mm at best
TOLERANCE_MM = 0.01
POINT_MM = 25.4 / 72.0
Points = list[tuple[float, float]]


def request(**changes: object) -> FilmRequest:
    asked = FilmRequest(
        46.0, 20.0, GridGeometry(16.5, 3.6), (6.0, 8.0), (1.5, 1.2), bench="cim-tr-97-06"
    )
    return dataclasses.replace(asked, **changes)


def pdf_paths(content: bytes) -> tuple[tuple[float, float], list[Points]]:
    """Return the sheet and the corners of every stroke, mm, from the page's own numbers."""
    page = PdfReader(io.BytesIO(content)).pages[0]
    assert float(page.get("/UserUnit", 1.0)) == 1.0
    stream = page.get_contents().get_data().decode("latin-1")
    scale, paths = 1.0, []
    for words, operator in re.findall(
        r"((?:[-.\d]+\s+){2,6})(cm|[mlc])\b", re.sub(r"\(.*\) Tj", "", stream)
    ):
        numbers = [float(word) for word in words.split()]
        if operator == "cm":
            assert numbers[0] == numbers[3]
            assert numbers[1:3] + numbers[4:] == [0.0] * 4
            scale *= numbers[0]
            continue
        if operator == "m":
            paths.append([])
        paths[-1].append(tuple(POINT_MM * scale * n for n in numbers[-2:]))
    sheet = tuple(POINT_MM * float(n) for n in (page.mediabox.width, page.mediabox.height))
    return sheet, paths


def svg_paths(content: bytes) -> tuple[tuple[float, float], list[Points]]:
    """Return the same of an SVG; a circle is its four outermost points."""
    root = ElementTree.fromstring(content)
    sheet = tuple(float(re.fullmatch(r"([\d.]+)mm", root.get(k))[1]) for k in ("width", "height"))
    box = [float(n) for n in root.get("viewBox").split()]
    scale = sheet[0] / box[2]
    assert sheet[1] / box[3] == pytest.approx(scale, rel=1e-6)
    paths = []
    for element in root.iter():
        match element.tag.rpartition("}")[2]:
            case "circle":
                x, y, r = (scale * float(element.get(name)) for name in ("cx", "cy", "r"))
                paths.append([(x + r, y), (x, y + r), (x - r, y), (x, y - r)])
            case "path" | "polygon":
                words = element.get("d") or element.get("points")
                pairs = re.findall(r"(-?[\d.]+)[ ,](-?[\d.]+)", words)
                paths.append([(scale * float(x), scale * float(y)) for x, y in pairs])
    return sheet, paths


def nearest(paths: list[Points], corners: Points) -> float:
    """Return by how much the stroke that fits best is off, at its worst corner, mm."""
    return min(
        max(min(math.dist(point, corner) for point in path) for corner in corners)
        for path in paths
        if len(path) >= len(corners)
    )


def turned(centre: tuple[float, float], angle: float, along: float, aside: float = 0.0):
    x, y = math.cos(angle), math.sin(angle)
    return centre[0] + along * x - aside * y, centre[1] + along * y + aside * x


def wrong_sizes(asked: FilmRequest, paths: list[Points]) -> dict[str, float]:
    """Return what is off by more than the tolerance, computed from the request alone."""
    centre, half = asked.centre, 0.5 * asked.geometry.spacing_mm
    radius = asked.geometry.radius_mm
    expected: dict[str, Points] = {}
    for r in (0.5 * asked.diameter_mm, 0.5 * asked.boss_mm, radius, radius - half, radius + half):
        expected[f"ring {r}"] = [turned(centre, k * math.pi / 2.0, r) for k in range(4)]
    for k in range(4):
        corner = turned(centre, math.pi / 4.0 + k * math.pi / 2.0, math.sqrt(2.0) * asked.target_mm)
        expected[f"target {k}"] = [turned(corner, j * math.pi / 2.0, 1.5) for j in range(4)]
    hand = -1.0 if asked.mirror else 1.0
    for rosette in asked.layout.rosettes:
        at = 0.5 * math.pi + hand * math.radians(rosette.angle_deg)
        boxes = {f"pad {rosette.number}": (radius, 0.0, asked.pad_mm[::-1])}
        # odd grids at +45 degrees and inside, unless the rosette is reversed
        for gauge, sign in zip(rosette.gauges, (1.0, -1.0), strict=True):
            inside = (sign > 0.0) != rosette.reverse
            place = radius - half if inside else radius + half
            boxes[f"grid R{gauge}"] = (place, sign * hand * math.pi / 4.0, asked.grid_mm)
        for name, (place, turn, (length, width)) in boxes.items():
            middle = turned(centre, at, place)
            expected[name] = [
                turned(middle, at + turn, 0.5 * a * length, 0.5 * b * width)
                for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
    off = {name: nearest(paths, corners) for name, corners in expected.items()}
    return {name: error for name, error in off.items() if not error < TOLERANCE_MM}


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize(("layout", "sheet"), [("four", "a4"), ("two", "letter"), ("spread", "a3")])
def test_every_size_of_both_files_is_as_asked(layout, sheet, mirror, tmp_path):
    asked = request(layout=LAYOUTS[layout], sheet=sheet, mirror=mirror)
    film = write_film(asked, tmp_path / "film.pdf")
    for found, paths in (pdf_paths(film.pdf.read_bytes()), svg_paths(film.svg.read_bytes())):
        assert found == pytest.approx(SHEETS[sheet], abs=TOLERANCE_MM)
        assert wrong_sizes(asked, paths) == {}
        for axis in (0, 1):
            spans = [abs(p[1][axis] - p[0][axis]) for p in paths if len(p) == 2]
            assert min(abs(span - 100.0) for span in spans) < TOLERANCE_MM
        points = [point for path in paths for point in path]
        assert all(9.99 < v < most - 9.99 for p in points for v, most in zip(p, found, strict=True))
    # a measure that sees nothing would pass: two hundredths of a millimetre must show
    wider = dataclasses.replace(asked, boss_mm=asked.boss_mm + 0.04)
    assert list(wrong_sizes(wider, paths)) == [f"ring {0.5 * wider.boss_mm}"]
    turned_round = dataclasses.replace(asked, mirror=not mirror)
    assert any(name.startswith("grid") for name in wrong_sizes(turned_round, paths))


def test_a_large_flexspline_with_small_grids_measures_right_too(tmp_path):
    # the turn of a grid is measured at the rosette's radius: digits count most here
    asked = FilmRequest(230.0, 150.0, GridGeometry(100.0, 1.5), (6.0, 8.0), (0.5, 0.5), sheet="a3")
    film = write_film(asked, tmp_path / "film.pdf")
    for _, paths in (pdf_paths(film.pdf.read_bytes()), svg_paths(film.svg.read_bytes())):
        assert wrong_sizes(asked, paths) == {}


def test_the_same_film_has_the_same_bytes_and_says_its_sizes(tmp_path):
    first, second = (write_film(request(), tmp_path / f"{n}.pdf") for n in "ab")
    assert first.pdf.read_bytes() == second.pdf.read_bytes()
    assert first.svg.read_bytes() == second.svg.read_bytes()
    assert first.sizes_mm["flexspline ring, diameter"] == 46.0
    words = PdfReader(first.pdf).pages[0].extract_text()
    assert "46 mm flexspline" in words
    assert "100.0 mm: measure it" in words
    mirrored = write_film(request(mirror=True), tmp_path / "m.pdf")
    assert "MIRRORED" in PdfReader(mirrored.pdf).pages[0].extract_text()


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"boss_mm": 30.0}, "--radius"),
        ({"geometry": GridGeometry(20.0, 3.6)}, "--radius"),
        ({"pad_mm": (26.0, 8.0), "diameter_mm": 60.0}, "--pad-width"),
        ({"geometry": GridGeometry(16.5, 7.0)}, "--grid-spacing"),
        ({"grid_mm": (6.0, 3.0)}, "--grid-length"),
        ({"diameter_mm": 150.0, "boss_mm": 20.0}, "--sheet"),
    ],
)
def test_what_does_not_fit_is_named_with_its_option(changes, where):
    with pytest.raises(UsageError) as caught:
        request(**changes)
    problems = caught.value.problems or (caught.value,)
    assert where in {problem.where for problem in problems}
    assert all("needed" in problem.what for problem in problems)


def test_a_name_that_is_no_pdf_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"\.pdf"):
        write_film(request(), tmp_path / "film.png")
