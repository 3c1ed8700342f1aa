"""The film: sizes measured by tools of others, refusals, nothing left half written."""

from __future__ import annotations

import dataclasses
import io
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from pypdf import PdfReader

from hdbench.errors import HdbenchError, UsageError
from hdbench.gauges import GridGeometry, layout_named
from hdbench.gauges.film import FilmRequest, write_film
from hdbench.gauges.film import write as write_module
from hdbench.gauges.film.check import check_film
from hdbench.gauges.film.compose import compose
from hdbench.gauges.film.drawing import Circle, Line, Outline
from hdbench.gauges.film.pdf import drawing_as_pdf
from hdbench.gauges.film.readback import read_pdf, read_svg
from hdbench.gauges.film.svg import drawing_as_svg

POINT = 25.4 / 72.0


def request(**changes: object) -> FilmRequest:
    asked = FilmRequest(
        46.0, 20.0, GridGeometry(16.5, 3.6), (6.0, 8.0), (1.5, 1.2), bench="cim-tr-97-06"
    )
    return dataclasses.replace(asked, **changes)


def plain_numbers(pdf: bytes, operator: str) -> list[list[float]]:
    """Return the operands of one operator by a regular expression over the content stream."""
    stream = PdfReader(io.BytesIO(pdf)).pages[0].get_contents().get_data().decode("latin-1")
    count = {"l": 2, "m": 2, "re": 4}[operator]
    pattern = r"([-\d.]+)\s+" * count + operator + r"\b"
    return [[float(n) for n in found] for found in re.findall(pattern, stream)]


def test_every_size_reads_back_within_a_hundredth_of_a_millimetre(tmp_path: Path) -> None:
    film = write_film(request(), tmp_path / "film.pdf")
    names = {d.name for d in film.dimensions["pdf"]}
    assert {"flexspline ring, diameter", "boss ring, diameter", "scale bar across"} <= names
    assert {"rosette 4 pad, radius", "grid R8, turned", "targets upright"} <= names
    assert film.largest_error_mm < 0.01
    assert [d.name for d in film.dimensions["svg"]] == [d.name for d in film.dimensions["pdf"]]


def test_the_bars_are_100_mm_in_the_pages_own_numbers(tmp_path: Path) -> None:
    # the content stream by regular expression: neither the writer nor our reader takes part
    pdf = write_film(request(), tmp_path / "film.pdf").pdf.read_bytes()
    starts, ends = plain_numbers(pdf, "m"), plain_numbers(pdf, "l")
    spans = {round(POINT * abs(a[0] - b[0]), 2) for a in starts for b in ends if a[1] == b[1]}
    tall = {round(POINT * abs(a[1] - b[1]), 2) for a in starts for b in ends if a[0] == b[0]}
    assert 100.0 in spans
    assert 100.0 in tall
    page = PdfReader(io.BytesIO(pdf)).pages[0]
    assert POINT * float(page.mediabox.width) == pytest.approx(210.0, abs=1e-3)
    assert POINT * float(page.mediabox.height) == pytest.approx(297.0, abs=1e-3)


def test_the_pdf_asks_for_no_scaling_and_holds_no_picture(tmp_path: Path) -> None:
    pdf = write_film(request(), tmp_path / "film.pdf").pdf
    reader = PdfReader(pdf)
    root = reader.trailer["/Root"]
    assert root["/ViewerPreferences"]["/PrintScaling"] == "/None"
    assert len(reader.pages[0].images) == 0
    words = reader.pages[0].extract_text()
    assert "100 %" in words
    assert "BOTH bars" in words


def test_lines_are_as_fine_as_asked(tmp_path: Path) -> None:
    film = write_film(request(line_mm=0.03), tmp_path / "film.pdf")
    stream = PdfReader(film.pdf).pages[0].get_contents().get_data().decode("latin-1")
    widths = {float(n) for n in re.findall(r"([\d.]+) w\b", stream)}
    assert len(widths) == 1
    assert widths.pop() == pytest.approx(0.03 / POINT, abs=1e-5)
    group = next(g for g in ElementTree.parse(film.svg).iter() if g.get("stroke-width"))
    assert group.get("stroke-width") == "0.03"


def test_the_svg_is_in_millimetres_with_the_rosettes_where_they_belong(tmp_path: Path) -> None:
    root = ElementTree.parse(write_film(request(), tmp_path / "film.pdf").svg).getroot()
    assert (root.get("width"), root.get("viewBox")) == ("210mm", "0 0 210 297")
    polygons = [
        [tuple(map(float, pair.split(","))) for pair in e.get("points", "").split()]
        for e in root.iter("{http://www.w3.org/2000/svg}polygon")
    ]
    circles = [float(e.get("r", "0")) for e in root.iter("{http://www.w3.org/2000/svg}circle")]
    assert {23.0, 10.0, 16.5, 14.7, 18.3} <= set(circles)
    pads = [p for p in polygons if len(p) == 4 and math.dist(p[0], p[2]) == pytest.approx(10.0)]
    middles = [(sum(x for x, _ in p) / 4, sum(y for _, y in p) / 4) for p in pads]
    # SVG counts y downwards: the first rosette is above the centre of the others
    xs, ys = zip(*middles, strict=True)
    centre = (sum(xs) / 4, sum(ys) / 4)
    assert sorted(round(math.dist(centre, m), 3) for m in middles) == [16.5] * 4
    assert middles[0][1] == pytest.approx(centre[1] - 16.5, abs=1e-3)
    # counter-clockwise as seen: the second is on the left
    assert middles[1][0] == pytest.approx(centre[0] - 16.5, abs=1e-3)


def test_the_third_rosette_is_turned_round() -> None:
    drawing = compose(request())
    places = {t.words: t.at for t in drawing.texts if re.fullmatch(r"R\d", t.words)}
    middle = request().centre

    def distance(name: str) -> float:
        return math.dist(places[name], middle)

    assert distance("R1") < distance("R2")
    assert distance("R6") < distance("R5")


def test_mirrored_rosettes_go_clockwise_and_their_grids_change_hands() -> None:
    plain, mirrored = (compose(request(mirror=m)) for m in (False, True))
    width = plain.width_mm

    def rectangles(drawing) -> set[tuple[float, ...]]:
        return {
            tuple(sorted((round(x, 6), round(y, 6)) for x, y in s.corners))
            for s in drawing.strokes
            if isinstance(s, Outline) and len(s.corners) == 4
        }

    turned = {
        tuple(sorted((round(width - x, 6), y) for x, y in corners)) for corners in rectangles(plain)
    }
    assert turned == rectangles(mirrored)
    assert any("MIRRORED" in t.words for t in mirrored.texts)


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("layout", ["four", "two", "spread"])
@pytest.mark.parametrize("sheet", ["a4", "letter", "a3"])
def test_every_layout_on_every_sheet_measures_right(
    layout: str, sheet: str, mirror: bool, tmp_path: Path
) -> None:
    asked = request(layout=layout_named(layout), sheet=sheet, mirror=mirror)
    assert write_film(asked, tmp_path / "film.pdf").largest_error_mm < 0.01


def test_a_large_flexspline_with_small_grids_measures_right_too(tmp_path: Path) -> None:
    # the turn of a grid is measured at the rosette's radius: digits count most here
    asked = FilmRequest(230.0, 150.0, GridGeometry(100.0, 1.5), (6.0, 8.0), (0.5, 0.5), sheet="a3")
    assert write_film(asked, tmp_path / "film.pdf").largest_error_mm < 0.01


def test_nothing_is_drawn_beyond_the_sheets_margin() -> None:
    for sheet in ("a4", "letter"):
        drawing = compose(request(sheet=sheet))
        for stroke in drawing.strokes:
            if isinstance(stroke, Line):
                points = [stroke.start, stroke.end]
            elif isinstance(stroke, Circle):
                (x, y), r = stroke.centre, stroke.radius_mm
                points = [(x - r, y - r), (x + r, y + r)]
            else:
                points = list(stroke.corners)
            for x, y in [*points, *(t.at for t in drawing.texts)]:
                assert 10.0 <= x <= drawing.width_mm - 10.0
                assert 10.0 <= y <= drawing.height_mm - 10.0


def moved(drawing, kind: type, index: int, by: float):
    """Return the drawing with one stroke moved along x."""
    places = [i for i, s in enumerate(drawing.strokes) if isinstance(s, kind)]
    stroke = drawing.strokes[places[index]]
    if isinstance(stroke, Circle):
        new = Circle(stroke.centre, stroke.radius_mm + by)
    elif isinstance(stroke, Line):
        new = Line(stroke.start, (stroke.end[0] + by, stroke.end[1]))
    else:
        new = Outline(tuple((x + by, y) for x, y in stroke.corners))
    strokes = list(drawing.strokes)
    strokes[places[index]] = new
    return dataclasses.replace(drawing, strokes=tuple(strokes))


@pytest.mark.parametrize(
    ("kind", "index", "words"),
    [(Circle, 0, "boss ring"), (Outline, 1, "rosette 1 pad"), (Outline, 2, "grid R1")],
)
def test_a_stroke_two_hundredths_off_is_found_in_both_files(kind, index, words) -> None:
    wrong = moved(compose(request()), kind, index, 0.02)
    for shapes in (read_pdf(drawing_as_pdf(wrong)), read_svg(drawing_as_svg(wrong))):
        with pytest.raises(HdbenchError, match=words) as caught:
            check_film(shapes, request(), "film")
        assert caught.value.exit_code == 1


def test_a_scaled_page_is_found() -> None:
    drawing = compose(request())
    pdf = drawing_as_pdf(dataclasses.replace(drawing, width_mm=210.5))
    with pytest.raises(HdbenchError, match="sheet width"):
        check_film(read_pdf(pdf), request(), "film")


def test_a_film_that_reads_back_wrong_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = moved(compose(request()), Circle, 0, 0.05)
    monkeypatch.setattr(write_module, "compose", lambda _request: wrong)
    old = tmp_path / "film.pdf"
    old.write_bytes(b"an older film")
    with pytest.raises(HdbenchError, match="nothing was written"):
        write_film(request(), old)
    assert old.read_bytes() == b"an older film"
    assert [p.name for p in tmp_path.iterdir()] == ["film.pdf"]


def test_the_same_film_has_the_same_bytes(tmp_path: Path) -> None:
    first, second = (write_film(request(), tmp_path / f"{n}.pdf") for n in "ab")
    assert first.pdf.read_bytes() == second.pdf.read_bytes()
    assert first.svg.read_bytes() == second.svg.read_bytes()


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"boss_mm": 30.0}, "--radius"),
        ({"geometry": GridGeometry(20.0, 3.6)}, "--radius"),
        ({"pad_mm": (26.0, 8.0), "diameter_mm": 60.0}, "--pad-width"),
        ({"geometry": GridGeometry(16.5, 7.0)}, "--grid-spacing"),
        ({"grid_mm": (6.0, 3.0)}, "--grid-length"),
        ({"line_mm": math.nan}, "--line"),
        ({"sheet": "a5"}, "--sheet"),
        ({"diameter_mm": 150.0, "boss_mm": 20.0}, "--sheet"),
    ],
)
def test_what_does_not_fit_is_named_with_its_option(changes, where: str) -> None:
    with pytest.raises(UsageError) as caught:
        request(**changes)
    problems = caught.value.problems or (caught.value,)
    assert where in {problem.where for problem in problems}
    assert all("needed" in problem.what for problem in problems)


def test_a_name_that_is_no_pdf_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"\.pdf"):
        write_film(request(), tmp_path / "film.png")
