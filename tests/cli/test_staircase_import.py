"""`hdbench import --kind staircase` finds plateaus, tells them, and calibrate takes the file."""

from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    """Return 10 Hz readings under 0, 2, 4, 2 and 0 kg at 1.5 V per kg, with two glitches."""
    rng = np.random.default_rng(1)
    levels = np.repeat([0.0, 3.0, 6.0, 3.0, 0.0], 80)
    volts = levels + 0.01 * rng.normal(size=len(levels))
    volts[[50, 200]] = -9.9
    file = tmp_path / "cell.csv"
    rows = [f"{100 * k},{v:.5f}" for k, v in enumerate(volts)]
    file.write_text("t_ms,volts\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return file


def words(raw: Path, out: Path, loads: str = "0,2,4,2,0") -> list[str | Path]:
    columns = ["--time", "t_ms*0.001", "--map", "reading_v=volts"]
    return [
        "import", "--kind", "staircase", raw, *columns,
        "--loads", loads, "--load-unit", "kg", "--out", out,
    ]  # fmt: skip


def test_the_plateaus_are_told_and_the_file_calibrates(hdbench, raw, tmp_path, answer):
    out = tmp_path / "loads.csv"
    text, _ = hdbench(*words(raw, out))
    assert "5 plateaus in 400 samples" in text
    assert "2 glitches left out, at 5.00, 20.00 s" in text
    body = answer(*words(raw, out))
    assert body["reading_per_load"] == pytest.approx(1.5, abs=0.005)
    assert body["glitches_at_s"] == [5.0, 20.0]
    result = answer("calibrate", "--from", out, "--out", tmp_path / "runs", "--no-report")
    # 1 kg on the built-in arm is 4.90325 N m, read as 1.5 V
    assert result["gain_nm_per_v"]["value"] == pytest.approx(4.90325 / 1.5, rel=0.005)
    assert result["course"]["excluded_at_s"] == [5.0, 20.0]


def test_a_count_that_does_not_match_is_an_error_of_the_data(hdbench, raw, tmp_path):
    _, error = hdbench(*words(raw, tmp_path / "loads.csv", "0,2,4"), code=4)
    assert "found 5 plateaus for 3 loads" in error
    assert "--loads" in error


def test_loads_that_are_no_numbers_are_wrong_usage(hdbench, raw, tmp_path):
    _, error = hdbench(*words(raw, tmp_path / "loads.csv", "0,two,4"), code=2)
    assert "list of numbers" in error
