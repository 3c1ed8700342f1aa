"""The command line, called in the process of the tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from hdbench_cli.main import main


@pytest.fixture
def hdbench(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[str, str]]:
    def run(*words: object, code: int = 0) -> tuple[str, str]:
        """Return stdout and stderr of a command that ends with `code`."""
        with pytest.raises(SystemExit) as end:
            main([str(word) for word in words])
        shown = capsys.readouterr()
        assert end.value.code == code, shown.err
        return shown.out, shown.err

    return run
