"""Write the table of the diagnosis' constants out of the code: value and reason of each.

`python tools/diagnosis_constants.py --write` writes docs/diagnosis-constants.md; without it the
command says whether the page is what the code says now, and exits 1 where it is not.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOM = ROOT / "hdbench" / "diagnosis"
PAGE = ROOT / "docs" / "diagnosis-constants.md"
HEAD = """<!-- made by tools/diagnosis_constants.py; change the code, not this page -->

# Constants of the diagnosis

Every number in `hdbench/diagnosis` that has a name, with its value and the reason that stands in
the code. Where a reason is "as above", that of the row before holds for this one too. Constants
that are only words, such as names of channels, are left out. Where a number decides something,
[diagnosis](diagnosis.md) says at which step.

There are {names} constants in {files} files.

| file | constant | value | reason |
|---|---|---|---|
"""


@dataclass(frozen=True)
class Row:
    """One assignment: file, names, value as the code has it, reason."""

    file: str
    names: tuple[str, ...]
    value: str
    reason: str


def rows() -> list[Row]:
    """Return every constant of the room, file by file."""
    return [row for path in sorted(ROOM.rglob("*.py")) for row in rows_of(path)]


def rows_of(path: Path) -> Iterator[Row]:
    """Yield the constants of one file."""
    text = path.read_text()
    lines = text.splitlines()
    last, reason = -1, ""
    body = ast.parse(text).body
    for place, node in enumerate(body):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = tuple(n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name))
        if not all(re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name) for name in names):
            continue
        own = comment_above(lines, node.lineno - 1) or text_below(body[place + 1 : place + 2])
        # constants in adjacent lines share the comment of the first
        reason = own or (reason and "as above" if node.lineno == last + 1 else "")
        last = node.end_lineno or node.lineno
        if is_number(node.value):
            value = ast.unparse(node.value)
            value = value[1:-1] if len(names) > 1 else value
            yield Row(str(path.relative_to(ROOM).with_suffix("")), names, value, reason)


def comment_above(lines: list[str], at: int) -> str:
    """Return the comment that ends in the line before, as one text."""
    first = at
    while first and lines[first - 1].startswith("#"):
        first -= 1
    return " ".join(line.lstrip("# ") for line in lines[first:at])


def text_below(following: list[ast.stmt]) -> str:
    """Return the text that stands below a constant in place of a comment above it."""
    match following:
        case [ast.Expr(value=ast.Constant(value=str(text)))]:
            return " ".join(text.split())
    return ""


def is_number(node: ast.expr) -> bool:
    """Return whether a value is made of numbers, by arithmetic alone."""
    parts = list(ast.walk(node))
    calls = [part.func for part in parts if isinstance(part, ast.Call)]
    plain = all(ast.unparse(call) in ("float", "np.log", "np.exp", "len") for call in calls)
    return plain and any(
        isinstance(part, ast.Constant) and isinstance(part.value, int | float) for part in parts
    )


def page() -> str:
    """Return the page."""
    found = rows()
    told = [
        f"| `{row.file}` | {', '.join(f'`{name}`' for name in row.names)} | `{row.value}` "
        f"| {row.reason} |"
        for row in found
    ]
    names = sum(len(row.names) for row in found)
    return HEAD.format(names=names, files=len({row.file for row in found})) + "\n".join(told) + "\n"


def main() -> int:
    """Write the page, or say whether it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the page")
    asked = parser.parse_args()
    if asked.write:
        PAGE.write_text(page())
        return 0
    if PAGE.exists() and PAGE.read_text() == page():
        return 0
    print(f"{PAGE.name} is not what the code says; run tools/diagnosis_constants.py --write")
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
