"""A shell completes commands, options and names, and its script is valid in that shell."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import pytest

from hdbench.filter import PRESETS
from hdbench.profile import list_profiles


def hdbench(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hdbench_cli", *words],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def completed(line: str) -> set[str]:
    words = line.split(" ")
    done = hdbench(
        _HDBENCH_COMPLETE="bash_complete", COMP_WORDS=line, COMP_CWORD=str(len(words) - 1)
    )
    assert done.stderr == ""
    return {row.partition(",")[2] for row in done.stdout.splitlines()}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one_that_its_shell_reads(shell: str) -> None:
    done = hdbench("completion", shell)
    assert done.returncode == 0
    assert "_HDBENCH_COMPLETE" in done.stdout
    assert "to install it" in done.stderr
    if program := shutil.which(shell):
        check = subprocess.run(
            [program, "-n"], input=done.stdout, text=True, capture_output=True, check=False
        )
        assert check.returncode == 0, check.stderr


def test_commands_and_options_are_completed() -> None:
    assert completed("hdbench run-") == {"run-misalignment", "run-ripple"}
    assert {"list", "show", "verify"} <= completed("hdbench runs ")
    assert "--materiality" in completed("hdbench diagnose --m")


def test_names_of_profiles_plants_and_filters_are_completed() -> None:
    assert set(list_profiles()) <= completed("hdbench run-ripple --profile ")
    assert "worn" in completed("hdbench run-ripple --plant w")
    assert {*PRESETS, "tuned"} <= completed("hdbench filter x.csv --model ")


def test_the_script_comes_as_json_too() -> None:
    done = hdbench("completion", "fish", "--json")
    body = json.loads(done.stdout)
    assert body["schema"] == "hdbench/completion/1"
    assert "complete" in body["script"]


def test_another_shell_is_refused_with_the_known_ones() -> None:
    done = hdbench("completion", "csh")
    assert done.returncode == 2
    assert "bash" in done.stderr
