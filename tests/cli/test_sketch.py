"""A curve in one line of characters shows its shape and its holes."""

import math

from hdbench_cli.sparkline import read_columns, span_of, sparkline


def test_a_ramp_becomes_rising_blocks():
    line = sparkline([float(x) for x in range(80)], 8, (0.0, 79.0))
    assert line == "".join(sorted(line))
    assert line[0] == "▁"
    assert line[-1] == "█"


def test_lost_values_leave_a_space_and_a_flat_curve_the_lowest_block():
    assert sparkline([math.nan, 1.0], 2, (0.0, 1.0), plain=True) == " @"
    assert sparkline([2.0, 2.0], 2, (2.0, 2.0), plain=True) == ".."


def test_no_line_is_longer_than_the_curve_or_the_width():
    assert len(sparkline([1.0] * 3, 40, (0.0, 1.0))) == 3
    assert len(sparkline([1.0] * 300, 40, (0.0, 1.0))) == 40


def test_a_table_gives_columns_and_their_span(tmp_path):
    file = tmp_path / "map.csv"
    file.write_text("a,b\n1,2\n,5\n")
    table = read_columns(file)
    assert table["b"] == [2.0, 5.0]
    assert math.isnan(table["a"][1])
    assert span_of(table, "a", "b") == (1.0, 5.0)
    assert read_columns(tmp_path / "none.csv") is None
