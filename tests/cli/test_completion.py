"""A shell completes commands, options and names, and its script is valid in that shell."""

import shutil

import pytest
from forked import ended

from hdbench.filter import PRESETS
from hdbench.profile import list_profiles


@pytest.fixture
def completed(hdbench, monkeypatch):
    """Return a function that completes a line as a shell asks for it."""

    def complete(line: str) -> set[str]:
        monkeypatch.setenv("_HDBENCH_COMPLETE", "bash_complete")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
        shown, said = hdbench()
        assert said == ""
        return {row.partition(",")[2] for row in shown.splitlines()}

    return complete


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one_that_its_shell_reads(shell, hdbench):
    script, said = hdbench("completion", shell)
    assert "_HDBENCH_COMPLETE" in script
    assert "to install it" in said
    if program := shutil.which(shell):
        check = ended([program, "-n"], input=script)
        assert check.returncode == 0, check.stderr


def test_commands_and_options_are_completed(completed):
    assert completed("hdbench run-") == {"run-misalignment", "run-ripple"}
    assert {"list", "show", "verify"} <= completed("hdbench runs ")
    assert "--materiality" in completed("hdbench diagnose --m")


def test_names_of_profiles_plants_and_filters_are_completed(completed):
    assert set(list_profiles()) <= completed("hdbench run-ripple --profile ")
    assert "worn" in completed("hdbench run-ripple --plant w")
    assert {*PRESETS, "tuned"} <= completed("hdbench filter x.csv --model ")


def test_the_script_comes_as_json_too(answer):
    body = answer("completion", "fish")
    assert body["schema"] == "hdbench/completion/1"
    assert "complete" in body["script"]


def test_another_shell_is_refused_with_the_known_ones(hdbench):
    assert "bash" in hdbench("completion", "csh", code=2)[1]
