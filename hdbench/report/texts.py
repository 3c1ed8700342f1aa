"""Texts of the pages: files in the folder of templates, filled with numbers."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.report import numbers

if TYPE_CHECKING:
    from collections.abc import Callable

    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"


# filters of the templates and of the cells of tables
_FILTERS = (
    *(numbers.declared, numbers.extra_lines, numbers.fixed, numbers.form, numbers.millivolts),
    *(numbers.percent, numbers.plain, numbers.ppm, numbers.probability, numbers.rounded_with),
    *(numbers.short, numbers.two_digits, numbers.with_std),
)


@cache
def declared(name: str) -> Mapping[str, Any]:
    """Return what a TOML file of the folder declares."""
    return tomllib.loads((TEMPLATES / f"{name}.toml").read_text(encoding="utf-8"))


def page_text(key: str, **told: object) -> str:
    """Return a text of the pages with its numbers."""
    return str(declared("texts")[key]).format_map(told)


def figure_texts(key: str, told: Mapping[str, object]) -> dict[str, str]:
    """Return title, caption and alternative text of a figure with their numbers."""
    entry = declared("texts")["figure"][key]
    return {name: text.format_map(told) for name, text in entry.items()}


@cache
def templates(*, autoescape: bool) -> Environment:
    """Return what fills templates; the numbers of a page are written by its filters."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"unit": numbers.unit_words, **{f.__name__: f for f in _FILTERS}}
    return environment


@cache
def expression(text: str) -> Callable[..., Any]:
    """Return what computes an expression of its names."""
    return templates(autoescape=False).compile_expression(text, undefined_to_none=False)


def filled(text: str, names: Mapping[str, object]) -> str:
    """Return a text with the expressions in double braces computed."""
    return templates(autoescape=False).from_string(text).render(names)


def summary(kind: str, *values: object) -> str:
    """Return what a run, a comparison or a history says in plain words."""
    macros = templates(autoescape=False).get_template("summaries.j2").module
    return re.sub(r"\s*\n\s*", " ", str(getattr(macros, kind)(*values))).lstrip()
