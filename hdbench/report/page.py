"""The HTML page: template and style filled with sections, all text escaped."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from hdbench import __version__
from hdbench.report.numbers import DASH, short, unit_words
from hdbench.report.pagefiles import ReportFiles
from hdbench.report.pagemodel import KeyNumber, Section

_TEMPLATES = Path(__file__).parent / "templates"
_BADGES = {"good": "In order", "look": "Look", "bad": "Not usable"}
_MARKS = {"good": "✓", "look": "!", "bad": "✕"}
# a head line shows the first numbers of each run: the sections list them all
_HEADLINES = 3
_FOOT = (
    "Uncertainties are standard uncertainties; intervals are at 95 % with the degrees of freedom "
    "of each number. Figure numbers refer to the technical report CIM-TR-97-06, whose figures "
    "these follow. Zoomed in, figures show every sample of curves of up to 8 000; longer ones are "
    "thinned by keeping the smallest and the largest value of each stretch. The raw files hold all."
)


@dataclass(frozen=True, slots=True)
class PageWords:
    """Words of a page that are not of its sections.

    `title` is empty for that of the sections; `noun` is what a section is about, in the plural.
    """

    title: str = ""
    noun: str = "runs"
    foot: str = _FOOT


def render_page(
    sections: Sequence[Section], files: ReportFiles, words: PageWords | None = None
) -> str:
    """Return the page."""
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # the figures are this package's own SVG, in which every text is escaped
    environment.filters["figure"] = Markup
    environment.filters["number"] = _number
    environment.filters["interval"] = _interval
    environment.filters["unit"] = unit_words
    environment.filters["dof"] = _dof
    words = words or PageWords()
    style = Markup((_TEMPLATES / "style.css").read_text(encoding="utf-8"))
    script = (_TEMPLATES / "zoom.js").read_text(encoding="utf-8")
    return environment.get_template("report.html.j2").render(
        style=style,
        script=Markup(script),
        script_hash=_hash(script),
        sections=sections,
        title=words.title or _title(sections),
        overall=_overall(sections, words.noun),
        noun=words.noun.capitalize(),
        foot=words.foot,
        badges=_BADGES,
        marks=_MARKS,
        headlines=_headlines(sections),
        csv=files.csv.name,
        json=files.json.name,
        version=__version__,
    )


def _hash(script: str) -> str:
    """Return what the page's policy names the one script that it lets run by."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _title(sections: Sequence[Section]) -> str:
    names = list(dict.fromkeys(section.title for section in sections))
    return names[0] if len(names) == 1 else "Bench report"


def _overall(sections: Sequence[Section], noun: str) -> dict[str, str]:
    levels = [section.verdict.level for section in sections]
    worst = next(level for level in ("bad", "look", "good") if level in levels)
    if len(sections) == 1:
        return {"level": worst, "text": sections[0].verdict.text}
    good = levels.count("good")
    words = [f"{good} of {len(levels)} {noun} are in order"]
    if levels.count("look"):
        words.append(f"{levels.count('look')} worth a look")
    if levels.count("bad"):
        words.append(f"{levels.count('bad')} not usable")
    return {"level": worst, "text": ", ".join(words) + "."}


def _headlines(sections: Sequence[Section]) -> list[tuple[Section, KeyNumber]]:
    share = _HEADLINES if len(sections) == 1 else 1 if len(sections) > 3 else 2
    found: list[tuple[Section, KeyNumber]] = []
    for section in sections:
        sure = [n for n in section.numbers if n.std and n.unit.startswith("N m")] or list(
            section.numbers
        )
        found += [(section, n) for n in sure[:share]]
    return found


def _number(n: KeyNumber) -> str:
    text = short(n.value, n.std)
    return f"{text} ± {short(n.std, n.std)}" if n.std else text


def _interval(n: KeyNumber) -> str:
    ends: Any = n.interval()
    if ends is None:
        return DASH
    return f"{short(ends[0], n.std)} to {short(ends[1], n.std)}"


def _dof(n: KeyNumber) -> str:
    if n.dof is None:
        return DASH
    return f"{n.dof:.3g}" if n.dof < 100.0 else f"{n.dof:.0f}"
