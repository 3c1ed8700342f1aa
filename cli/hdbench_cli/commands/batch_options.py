"""What a batch asks of every input: options of the command that it runs, and their meaning."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
from click.core import ParameterSource

from hdbench import __version__
from hdbench.batch import Input, content_of
from hdbench.errors import UsageError, nothing_stored
from hdbench_cli.commandline import batch_options
from hdbench_cli.inputs import choose_profile


@dataclass(frozen=True, slots=True)
class Job:
    """What is asked of one input: words of the command line, and the digest of their meaning."""

    options: tuple[str, ...]
    digest: str


class Asked:
    """What is asked of every input, with files among the options known by their content."""

    def __init__(self, name: str, ctx: click.Context) -> None:
        self._name = name
        self._words = [*_words(ctx, name)]
        self._known = {option for param in batch_options(name) for option in param.opts}
        self._digests: dict[str, str] = {}

    def job(self, entry: Input) -> Job:
        """Return what is asked of one input."""
        given = {"--profile": entry.profile, "--calibration": entry.calibration}
        words = list(self._words)
        for option, value in given.items():
            if value and option not in self._known:
                raise UsageError(
                    f"the list names a {option[2:]}, and {self._name} takes none",
                    where=str(entry.path),
                    fix="leave that column out",
                )
            words += [(option, value)] if value else []
        profile = dict(words).get("--profile", "")
        meaning = [
            __version__,
            self._name,
            self._profile(profile) if "--profile" in self._known else "",
            [(option, self._meaning(value)) for option, value in words],
        ]
        digest = hashlib.sha256(json.dumps(meaning).encode()).hexdigest()
        flat = (word for pair in words for word in (pair[0], _absolute(pair[1])) if word)
        return Job(tuple(flat), digest)

    def _meaning(self, value: str) -> str:
        """Return the digest of what a word names, else the word."""
        if value not in self._digests:
            found = bool(value) and Path(value).exists()
            self._digests[value] = content_of(Path(value)).sha256 if found else value
        return self._digests[value]

    def _profile(self, name: str) -> str:
        key = f"profile {name}"
        if key not in self._digests:
            self._digests[key] = choose_profile(name or None, None).sha256
        return self._digests[key]


def _words(ctx: click.Context, name: str) -> Iterator[tuple[str, str]]:
    """Yield the options that were typed for the command, each with its value, empty for a flag."""
    for option in batch_options(name):
        key = str(option.name)
        if ctx.get_parameter_source(key) is not ParameterSource.COMMANDLINE:
            continue
        value = ctx.params[key]
        for one in value if option.multiple else (value,):
            if isinstance(one, Path) and not one.exists():
                raise nothing_stored(one)
            yield option.opts[0], "" if option.is_flag else str(one)


def _absolute(value: str) -> str:
    """Return a word that names a file here so that it does so for every worker."""
    return str(Path(value).absolute()) if value and Path(value).exists() else value
