"""Exported source: builds without a warning, answers as the host, here and on a Cortex-M4F."""

import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forked import ended
from kernel_models import KINDS, new_state, order_block, run, slow_block

from hdbench.errors import StorageError
from hdbench.filter import SlowBlock, preset
from hdbench.filter.firmware import export_firmware
from hdbench.filter.model import FilterModel

PERIOD = 1e-3
# two states, and one that turns
FEW_KINDS = ("integrated-random-walk", "resonance")
needs_compiler = pytest.mark.skipif(
    shutil.which("cc") is None or shutil.which("make") is None, reason="cc or make is not here"
)
needs_target = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None or shutil.which("qemu-system-arm") is None,
    reason="arm-none-eabi-gcc or qemu-system-arm is not here; `make firmware-check` says more",
)
# as one command of the compiler sees it: a program that filters a file of float32 pairs
DRIVER = """
#include <stdio.h>
#include "hdb_model.h"
int main(void)
{
    static hdb_state state;
    hdb_output out;
    hdb_real pair[2];
    while (fread(pair, sizeof pair[0], 2, stdin) == 2) {
        hdb_filter_step(&hdb_exported_model, &state, HDB_SAMPLE_PERIOD_S, pair[0], pair[1], &out);
        if (fwrite(&out.filtered, sizeof out.filtered, 1, stdout) != 1)
            return 1;
    }
    return 0;
}
"""


def tuned(bench, kind="matern-3/2"):
    ripple = (order_block(2.0, 1e-5), order_block(4.0, 1e-5))
    return replace(
        preset("report-6", bench),
        name="tuned",
        blocks=(*ripple, order_block(0.01, 1e-6, "misalignment")),
        slow=(slow_block(kind),),
        measurement_noise=2.5e-3,
        order_prior_std_nm=1.0,
        slow_prior_std_nm=2.0,
        gate_sigma=6.0,
    )


def named(bench, name):
    return tuned(bench) if name == "tuned" else preset(name, bench)


def exported(model: FilterModel, folder: Path) -> Path:
    export_firmware(model, folder, sample_period_s=PERIOD, source="a test")
    return folder


def make(folder: Path, *targets: str) -> str:
    found = ended(["make", "-s", *targets], cwd=folder)
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


@needs_compiler
@pytest.mark.parametrize("name", ["report-a1", "report-a2", "report-6"])
def test_a_preset_builds_without_a_warning_and_passes_its_self_test(bench, tmp_path, name):
    assert "PASSED" in make(exported(preset(name, bench), tmp_path))


@needs_compiler
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=pytest.mark.campaign) if kind not in FEW_KINDS else kind
        for kind in KINDS
    ],
)
def test_a_tuned_model_passes_in_float_and_in_double(bench, tmp_path, kind):
    folder = exported(tuned(bench, kind), tmp_path)
    assert "PASSED" in make(folder)
    said = make(folder, "double")
    # the same source in the same precision: no more than the compiler's own products
    assert int(re.search(r"largest difference (\d+) nN m", said)[1]) == 0


@needs_compiler
def test_a_start_that_knows_little_passes_in_float(bench, tmp_path):
    # as tuning writes it for the bench: P = 1600 beside R = 0.0025 nearly uses up a float's 24 bits
    model = replace(tuned(bench, "resonance"), order_prior_std_nm=4.0, slow_prior_std_nm=40.0)
    walk = SlowBlock("random-walk", noise_per_s=1e-4)
    folder = exported(replace(model, slow=(walk, *model.slow)), tmp_path)
    assert "PASSED" in make(folder)
    assert "PASSED" in make(folder, "sanitize")


@needs_compiler
def test_the_self_test_fails_where_the_numbers_are_others(bench, tmp_path):
    folder = exported(preset("report-6", bench), tmp_path)
    header = folder / "hdb_model.h"
    header.write_text(header.read_text().replace(".order = (hdb_real)4,", ".order = (hdb_real)5,"))
    found = ended(["make", "-s", "OPT=-O0"], cwd=folder)
    assert found.returncode != 0
    assert "FAILED" in found.stdout


@needs_compiler
@pytest.mark.parametrize("name", [pytest.param("report-6", marks=pytest.mark.campaign), "tuned"])
def test_float_stays_within_a_millinewtonmetre_of_double_for_ten_minutes(bench, tmp_path, name):
    model = named(bench, name)
    folder = exported(model, tmp_path)
    (folder / "driver.c").write_text(DRIVER)
    build = "cc -std=c99 -O2 -DHDB_EXPORTED filter.c driver.c -o driver"
    subprocess.run(build.split(), cwd=folder, check=True)
    t = np.arange(600_000) * float(np.float32(PERIOD))
    velocity = 100.0 + 56.0 * np.sin(2.0 * np.pi * 0.05 * t)
    velocity[(t > 290.0) & (t < 300.0)] = 0.0
    velocity[t > 300.0] *= -1.0
    angle = np.cumsum(velocity) * PERIOD
    rng = np.random.default_rng(4)
    torque = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle) + 3.0 * np.cos(angle / 100.0)
    torque += 2.0 * np.sin(4.0 * np.pi * t) + rng.normal(0.0, 0.05, t.size)
    pairs = np.stack([velocity, torque], axis=1).astype(np.float32)
    answer = subprocess.check_output([folder / "driver"], input=pairs.tobytes())
    single = np.frombuffer(answer, dtype=np.float32)
    exact = pairs.astype(np.float64)
    wanted = run(model, new_state(model), t, exact[:, 0], exact[:, 1]).torque_filtered_nm
    # what is asked for, N m
    assert np.abs(single - wanted).max() < 1e-3


@needs_target
@pytest.mark.parametrize("name", ["report-6", "tuned"])
def test_the_self_test_passes_on_a_cortex_m4f_within_its_instructions(bench, tmp_path, name):
    said = make(exported(named(bench, name), tmp_path), "target")
    assert "PASSED" in said
    count = int(re.search(r"instructions per sample (\d+)", said)[1])
    assert count > 100
    if name == "report-6":
        assert count <= 600  # what is asked for six states


@needs_target
def test_the_float_build_calls_no_double_arithmetic_and_no_library(bench, tmp_path):
    folder = exported(preset("report-6", bench), tmp_path)
    flags = "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard -O3 -std=c99"
    build = f"arm-none-eabi-gcc {flags} -DHDB_EXPORTED -ffreestanding -c filter.c -o filter.o"
    subprocess.run(build.split(), cwd=folder, check=True)
    nm = ["arm-none-eabi-nm", "--undefined-only", "filter.o"]
    names = subprocess.check_output(nm, cwd=folder, text=True).split()
    # a double needs __aeabi_d*; memset and memcpy come from the compiler itself
    assert set(names) - {"U"} <= {"memset", "memcpy"}


def test_the_header_says_where_its_numbers_are_from(bench, tmp_path):
    model = replace(preset("report-6", bench), provenance={"noise": "a file */ of ours"})
    header = (exported(model, tmp_path) / "hdb_model.h").read_text()
    assert "model report-6 from a test" in header
    assert re.search(r"sha256 of the model [0-9a-f]{64}", header)
    assert "a file * / of ours" in header
    assert ".q_sample = (hdb_real)0.050000000000000003" in header


def test_a_folder_that_cannot_be_written_is_a_storage_fault(bench, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError):
        exported(preset("report-6", bench), tmp_path / "file" / "x")


def test_the_command_writes_a_folder_and_one_json_object(tmp_path, answer):
    body = answer("export", "--model", "report-a1", "--out", tmp_path / "fw")
    assert body["schema"] == "hdbench/export/1"
    assert set(body["files"]) == set(os.listdir(tmp_path / "fw"))
