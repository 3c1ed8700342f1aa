"""`hdbench tune`, `response`, `orders` and what `filter` adds, from the command line's side."""

import csv
import gzip
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from runkit import ran
from tuning_traces import needs_compiled_kernel

from hdbench.filter import load_filter_model, preset
from hdbench.profile import load_profile

OU = ("--slow", "ornstein-uhlenbeck")


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return 5 s of a swinging speed with ripple, misalignment, slow torque and its truth."""
    rng = np.random.default_rng(1)
    n = 5000
    t = np.arange(n) * 1e-3
    v = 100.0 - 60.0 * np.cos(2.0 * t)
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * 1e-3)])
    slow = np.convolve(rng.normal(0.0, 0.3, n + 99), np.exp(-np.arange(100) / 30.0), "valid")
    waves = 1.2 * np.cos(2 * angle + 0.6) + 0.6 * np.cos(4 * angle) + 3.0 * np.cos(angle / 100)
    torque = slow + waves + rng.normal(0.0, 0.05, n)
    path = tmp_path_factory.mktemp("traces") / "trace.csv"
    columns = np.stack([t, v, angle, torque, slow], axis=1)
    names = "time_s,motor_velocity_rad_s,motor_angle_rad,torque_nm,torque_true_nm"
    np.savetxt(path, columns, delimiter=",", header=names, comments="", fmt="%.12g")
    return path


@pytest.fixture(scope="module")
def tuned(trace: Path) -> tuple[Path, dict]:
    needs_compiled_kernel()
    out = trace.parent / "tuned.json"
    return out, json.loads(ran("tune", trace, "--out", out, *OU, "--json"))


@pytest.fixture
def other(trace: Path, tmp_path: Path) -> Path:
    """Return the same trace under another name."""
    return shutil.copy(trace, tmp_path / "other.csv")


def head(path: Path) -> list[str]:
    return next(csv.reader(path.read_text().splitlines()))


def test_tune_writes_a_model_that_every_command_reads(tuned, trace, answer):
    out, body = tuned
    assert body["schema"] == "hdbench/tune/1"
    assert body["converged"] is True
    assert body["inputs"][0]["sha256"]
    model = load_filter_model(str(out), load_profile("cim-tr-97-06").data)
    assert model.to_dict() == body["filter"] == json.loads(out.read_text())
    assert str(trace) in " ".join(model.provenance)
    clean = trace.parent / "clean.csv"
    body = answer("filter", trace, "--model", out, "--out", clean)
    assert body["filter"]["name"] == "tuned"
    assert body["sample_flags"]["stuck"] == body["sample_flags"]["missing"] == 0
    assert head(clean)[-1] == "torque_filtered_nm"


def test_tune_names_what_the_data_cannot_say_and_prints_it(trace, tuned, hdbench):
    assert any("output turns" in note for note in tuned[1]["notes"])
    out = trace.parent / "shown.json"
    shown, _ = hdbench("tune", trace, "--out", out, "--slow", "random-walk")
    for word in ("measurement_noise", "NIS", "Ljung-Box", "unbounded variance", str(out)):
        assert word in shown


def test_an_order_of_ones_own_is_tuned_too(trace, tmp_path, answer):
    short = tmp_path / "short.csv"
    short.write_text("\n".join(trace.read_text().splitlines()[:2501]) + "\n")
    arguments = ("--out", tmp_path / "seven.json", *OU, "--order", "7.9", "--gate", "0")
    body = answer("tune", short, *arguments)
    assert [b["order"] for b in body["filter"]["blocks"]] == [2.0, 4.0, 0.01, 7.9]
    assert "gate_sigma" not in body["filter"]


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--out", "t.json", "--order", "2"], "--order"),
        (["--out", "t.json", "--gate", "1"], "--gate"),
    ],
)
def test_a_wrong_call_names_its_option(trace, monkeypatch, arguments, what, hdbench):
    monkeypatch.chdir(trace.parent)
    assert what in hdbench("tune", trace, *arguments, code=2)[1]


def test_the_model_tuned_is_tuned_on_this_very_trace(trace, answer):
    out = trace.parent / "own.csv"
    model = answer("filter", trace, "--model", "tuned", "--out", out)["filter"]
    assert model["name"] == "tuned"
    assert str(trace) in model["provenance"]["noise"]


def test_filter_adds_orders_and_comparison_on_request(tuned, trace, tmp_path, answer, hdbench):
    out, plot = tmp_path / "more.csv", tmp_path / "more.svg"
    words = ("filter", trace, "--model", tuned[0], "--out", out, "--compare")
    body = answer(*words, "--smooth", "--plot", plot)
    assert [row["name"] for row in body["orders"]] == ["order_2", "order_4", "order_0.01"]
    assert body["comparison"]["reference"] == "truth"
    names = [row["name"] for row in body["comparison"]["rows"]]
    assert names == ["raw", "lowpass", "report", "tuned", "smoothed"]
    columns = head(out)
    # those that every filtered trace has are held against the contract in test_filter_command
    assert columns[5] == "torque_filtered_nm"
    assert {"order_2_amplitude_nm", "order_2_phase_std_rad", "torque_lowpass_nm"} <= set(columns)
    assert plot.read_text().lstrip().startswith("<?xml")
    assert "torque kept" in hdbench(*words)[0]


def test_response_gives_the_share_of_torque_that_the_report_keeps(tmp_path, answer, hdbench):
    plot = tmp_path / "response.png"
    arguments = ("--model", "report-a1", "--velocity", 50, "--velocity", 156, "--plot", plot)
    body = answer("response", *arguments)
    assert body["schema"] == "hdbench/response/1"
    # three printed digits
    shares = [item["gain_at_zero"] for item in body["responses"]]
    assert shares == pytest.approx([0.141, 0.531], abs=6e-4)
    injected = body["responses"][0]["injection"][0]
    assert injected["measured"] == pytest.approx(injected["algebra"], abs=1e-6)
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "notch order 2" in hdbench("response", "--model", "report-a1")[0]


def test_orders_writes_spectrum_map_and_waves(tuned, trace, tmp_path, answer):
    out, table, plot = tmp_path / "o.csv", tmp_path / "m.csv", tmp_path / "o.svg"
    files = ("--out", out, "--map", table, "--plot", plot)
    body = answer("orders", trace, "--model", tuned[0], *files)
    assert body["schema"] == "hdbench/orders/1"
    peaks = {round(p["order"]): p["amplitude_nm"] for p in body["peaks"]}
    # the slow torque's noise under the lines
    assert peaks[2] == pytest.approx(1.2, rel=0.1)
    assert peaks[4] == pytest.approx(0.6, rel=0.1)
    assert head(table) == ["time_s", "motor_velocity_rad_s", "order", "amplitude_nm"]
    assert "order_2_amplitude_nm" in head(out)
    assert plot.stat().st_size > 1000
    assert body["angle"] == "measured"


def test_a_picture_of_another_kind_is_refused(tmp_path, hdbench):
    assert ".svg" in hdbench("response", "--plot", tmp_path / "response.gif", code=2)[1]


@pytest.mark.parametrize("name", ["nowhere/tuned.json", "result.json", "tuned.txt"])
def test_tuning_checks_where_it_writes_before_it_tunes(trace, tmp_path, monkeypatch, name, hdbench):
    def tuned_anyway(*_: object) -> None:
        raise AssertionError("tuned before the target was checked")

    monkeypatch.setattr("hdbench_cli.commands.tune.tune_inputs", tuned_anyway)
    (tmp_path / "result.json").write_text('{"schema": "hdbench/ripple/1"}')
    assert "--out" in hdbench("tune", trace, "--out", tmp_path / name, code=2)[1]
    assert (tmp_path / "result.json").read_text() == '{"schema": "hdbench/ripple/1"}'


def test_the_measured_file_is_never_written_over(trace, hdbench):
    told = hdbench("orders", trace, "--out", trace, code=2)[1]
    assert "belongs to the measured data" in told


def test_several_inputs_are_filtered_into_a_folder_and_told_in_one_object(
    trace, tmp_path, answer, hdbench
):
    other = tmp_path / "other.csv.gz"
    other.write_bytes(gzip.compress(trace.read_bytes()))
    out = tmp_path / "clean"
    body = answer("filter", trace, other, "--out", out)
    made = [result["out"] for result in body["results"]]
    assert made == [str(out / "trace.csv"), str(out / "other.csv")]
    assert (out / "trace.csv").read_bytes() == (out / "other.csv").read_bytes()
    single = answer("filter", trace, "--out", tmp_path / "one.csv")
    assert {**body["results"][0], "out": ""} == {**single, "out": ""}
    assert body["schema"] == single["schema"]
    assert "other.csv.gz" in hdbench("filter", trace, other, "--out", out)[0]


@pytest.mark.parametrize(
    "words",
    [
        ["{trace}", "{trace}", "--out", "{folder}"],  # one name twice
        ["{trace}", "{other}", "--out", "{folder}.csv"],  # one file for two inputs
        ["{trace}", "--out", "{here}"],  # a folder for one input
        ["{trace}", "{other}", "--out", "{folder}", "--compare", "--plot", "p.svg"],
    ],
)
def test_outputs_that_do_not_fit_several_inputs_are_refused(trace, other, tmp_path, words, hdbench):
    names = {"trace": trace, "other": other, "folder": tmp_path / "clean", "here": tmp_path}
    hdbench("filter", *(word.format(**names) for word in words), code=2)
    assert not (tmp_path / "clean").exists()


def test_orders_of_several_inputs_come_as_a_list(trace, other, tmp_path, answer):
    out = ("--out", tmp_path / "waves")
    results = answer("orders", trace, other, "--model", "report-6", *out)["results"]
    assert results[0]["tracked"] == results[1]["tracked"]
    assert sorted(p.name for p in (tmp_path / "waves").iterdir()) == ["other.csv", "trace.csv"]


def test_saturated_and_stuck_samples_make_the_filtered_trace_doubtful(trace, tmp_path, answer):
    model, hurt = tmp_path / "m.json", tmp_path / "hurt.csv"
    report = preset("report-6", load_profile("cim-tr-97-06").data)
    limited = replace(report, torque_limit_nm=50.0, stuck_samples=20)
    model.write_text(json.dumps(limited.to_dict()))
    rows = [line.split(",") for line in trace.read_text().splitlines()]
    column = rows[0].index("torque_nm")
    for row in rows[1000:1010]:
        row[column] = "60.0"
    for row in rows[2000:2050]:
        row[column] = "0.25"
    hurt.write_text("\n".join(map(",".join, rows)) + "\n")
    found = answer("filter", hurt, "--model", model, "--out", tmp_path / "o.csv", code=6)
    # a run of 50 equal samples is known as stuck from its 20th on
    counts = {flag["name"]: flag["samples"] for flag in found["flags"]}
    assert counts == {"saturation": 10, "stuck": 31}
