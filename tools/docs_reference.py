"""Reference pages of the documentation, made from the code: commands, profile, results, registers.

`python tools/docs_reference.py --write` writes docs/reference/ (or another folder); without it the
command says whether the one page that is kept in the project, profile.md, is what the code says,
and exits 1 where it is not. The other pages are made when the site is built.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
import types
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Union, get_args, get_origin

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from result_keys import KINDS, json_schema, keys_of

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "reference"
MADE = "<!-- made by tools/docs_reference.py; change the code, not this page -->\n\n"


def cell(text: object) -> str:
    """Return a text as one cell of a table."""
    return " ".join(str(text).split()).replace("|", "\\|")


# -- commands -------------------------------------------------------------------------------------


def commands_page() -> str:
    """Return the page of all commands."""
    from hdbench_cli.main import cli

    parts = [MADE + "# Commands\n"]
    parts.append(
        "Every command takes `--json` (exactly one JSON object on stdout, errors too), `-v` and "
        "`--help`. Results go to stdout, everything else to stderr.\n"
    )
    for path, command in walk(cli, "hdbench"):
        parts.append(command_part(path, command))
    return "\n".join(parts)


def walk(group: click.Group, path: str) -> Iterator[tuple[str, click.Command]]:
    """Yield every command that is no group, with its path."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from walk(command, f"{path} {name}")
        elif command is not None:
            yield f"{path} {name}", command


def command_part(path: str, command: click.Command) -> str:
    """Return the part of one command."""
    arguments = " ".join(
        p.make_metavar(click.Context(command))
        for p in command.params
        if isinstance(p, click.Argument)
    )
    lines = [f"## {path}\n", f"`{path} [OPTIONS] {arguments}`".replace(" `", "`") + "\n"]
    told, examples = help_text(command)
    lines.append(told + "\n")
    options = [p for p in command.params if isinstance(p, click.Option)]
    options = [o for o in options if not {"--json", "--verbose"} & set(o.opts)]
    if options:
        lines.append("| option | meaning |\n|---|---|")
        lines += [option_row(option, command) for option in options]
        lines.append("")
    if command.epilog:
        examples += example_lines(command.epilog)
    if examples:
        lines.append("```sh\n" + "\n".join(examples) + "\n```\n")
    return "\n".join(lines)


def help_text(command: click.Command) -> tuple[str, list[str]]:
    """Return the help of a command, its paragraphs each on one line, and the examples in it."""
    text = inspect.cleandoc(command.help or "")
    parts = [" ".join(part.split()) for part in text.split("\n\n")]
    examples = [line for p in parts if p.startswith("Example") for line in example_lines(p)]
    return "\n\n".join(p for p in parts if not p.startswith("Example")), examples


def example_lines(text: str) -> list[str]:
    """Return the command lines of an example."""
    told = " ".join(text.split()).removeprefix("Examples: ").removeprefix("Example: ")
    return [line.strip("`. ") for line in re.split(r";\s*(?=hdbench )", told)]


def option_row(option: click.Option, command: click.Command) -> str:
    """Return the row of one option."""
    names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
    if not option.is_flag and not option.count:
        names += f" `{cell(option.make_metavar(click.Context(command)))}`"
    notes = [option.help or ""]
    if option.multiple:
        notes.append("May be given several times.")
    if option.required:
        notes.append("Required.")
    if option.show_default is not False and option.default not in (None, (), False, ""):
        notes.append(f"Default `{option.default}`.")
    return f"| {names} | {cell(' '.join(notes))} |"


# -- profile --------------------------------------------------------------------------------------


def profile_page() -> str:
    """Return the page of all profile keys."""
    from hdbench.profile.schema import ProfileData

    parts = [
        MADE + "# Profile keys\n",
        "A profile is a TOML file. Every key has its unit in its name or its meaning; a key that "
        "is not listed here is an error, told with its line. `hdbench profile new NAME` writes "
        "one to start from, `hdbench profile schema` prints the JSON schema for editors.\n",
        table_rows("", ProfileData),
    ]
    seen: set[type[BaseModel]] = {ProfileData}
    for path, model in tables(ProfileData, ""):
        if model in seen and not path:
            continue
        seen.add(model)
        summary = " ".join((model.__doc__ or "").split())
        parts.append(f"## [{path}]\n\n{summary}\n\n{table_rows(path, model)}")
    return "\n".join(parts)


def tables(model: type[BaseModel], path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield every table below a model, with its path."""
    for name, field in model.model_fields.items():
        for inner in tables_of(field):
            where = f"{path}.{name}" if path else name
            yield where, inner
            yield from tables(inner, where)


def tables_of(field: FieldInfo) -> list[type[BaseModel]]:
    """Return the tables that a key holds, of every driver where they depend on it."""
    from hdbench.profile.acquiring import ByDriver, PluginAcquisition

    for mark in field.metadata:
        if isinstance(mark, ByDriver):
            return [*mark.tables().values(), PluginAcquisition]
    return models_of(field.annotation)


def models_of(kind: Any) -> list[type[BaseModel]]:
    """Return the tables that an annotation holds."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return [kind]
    return [m for part in get_args(kind) for m in models_of(part)]


def table_rows(path: str, model: type[BaseModel]) -> str:
    """Return the keys of one table as rows."""
    rows = ["| key | type | domain | default | meaning |", "|---|---|---|---|---|"]
    for name, field in model.model_fields.items():
        if tables_of(field):
            rows.append(f"| `{name}` | table{plural(field)} | | {default_of(field)} | see below |")
            continue
        rows.append(
            f"| `{name}` | {cell(type_words(field.annotation))} | {cell(domain_of(field))} "
            f"| {default_of(field)} | {cell(field.description or '')} |"
        )
    return "\n".join(rows) + "\n"


def plural(field: FieldInfo) -> str:
    """Return the plural ending of a list of tables."""
    return "s" if get_origin(field.annotation) is tuple else ""


def type_words(kind: Any) -> str:
    """Return an annotation in words."""
    if kind is type(None):
        return "none"
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " or ".join(type_words(part) for part in inner if part is not type(None))
    if origin is tuple:
        return f"list of {type_words(inner[0])}"
    if str(origin).endswith("Literal") or str(kind).startswith("typing.Literal"):
        return ", ".join(f'"{word}"' for word in inner)
    if inner:
        return type_words(inner[0])
    return {"str": "text", "float": "number", "int": "integer", "bool": "true or false"}.get(
        getattr(kind, "__name__", str(kind)), getattr(kind, "__name__", str(kind))
    )


def domain_of(field: FieldInfo) -> str:
    """Return the domain of a key."""
    words = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    found = []
    for rule in field.metadata:
        found += [
            f"{sign} {getattr(rule, name):g}"
            for name, sign in words.items()
            if getattr(rule, name, None) is not None
        ]
        if getattr(rule, "min_length", None):
            found.append(f"at least {rule.min_length}")
        if getattr(rule, "pattern", None):
            found.append(f"`{rule.pattern}`")
    return ", ".join(found)


def default_of(field: FieldInfo) -> str:
    """Return the default of a key."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=False)
    if isinstance(value, BaseModel):
        return "its own"
    return "none" if value in (None, (), "") else f"`{cell(value)}`"


# -- exit codes -----------------------------------------------------------------------------------


def exit_page() -> str:
    """Return the page of exit codes."""
    from hdbench import errors

    kinds = [value for value in vars(errors).values() if inspect.isclass(value)]
    kinds = sorted((k for k in kinds if issubclass(k, errors.HdbenchError)), key=codes)
    rows = [
        f"| {code_words(kind)} | `{kind.kind}` | {cell((kind.__doc__ or '').splitlines()[0])} |"
        for kind in kinds
        if kind is not errors.HdbenchError
    ]
    head = (
        "| exit | kind in `--json` | when |\n|---|---|---|\n"
        "| 0 | | Done; every check that was asked for passed. |\n"
        "| 1 | `bug` | A bug; with `-v` the only case with a traceback. |\n"
    )
    return (
        MADE
        + "# Exit codes\n\nAn error says what is wrong, where, and one act that mends it; with "
        '`--json` as `{"error": {kind, what, where, fix, exit_code}}` on stdout.\n\n'
        + head
        + "\n".join(rows)
        + "\n"
    )


def codes(kind: Any) -> tuple[bool, int, str]:
    """Return what errors are sorted by."""
    return kind.__name__ == "Stopped", kind.exit_code, kind.__name__


def code_words(kind: Any) -> str:
    """Return the exit code of an error in words."""
    return "129, 130, 143" if kind.__name__ == "Stopped" else str(kind.exit_code)


# -- results --------------------------------------------------------------------------------------


def results_page() -> str:
    """Return the page of result keys."""
    parts = [
        MADE + "# Result keys\n",
        "What `result.json` and `--json` hold, for every kind of result: every key, also inside "
        "tables (`name.key`) and the entries of lists (`name[].key`). *uncertain* is an object "
        "`value`, `std` (standard uncertainty), `dof` (degrees of freedom or null). A unit stands "
        "in the name or in the column. No result holds NaN or an infinity. JSON schemas: "
        + ", ".join(f"[{kind}]({kind}.schema.json)" for kind in KINDS)
        + ".\n",
    ]
    for kind in KINDS:
        rows = ["| key | type | unit | meaning |", "|---|---|---|---|"]
        rows += [
            f"| `{row.key}` | {cell(row.type)} | {row.unit} | {cell(row.meaning)} |"
            for row in keys_of(kind).values()
        ]
        parts.append(f"## {kind}\n\n" + "\n".join(rows) + "\n")
    return "\n".join(parts)


def schema_file(kind: str) -> str:
    """Return the JSON schema of one kind of result."""
    return json.dumps(json_schema(kind), indent=1)


# -- registers ------------------------------------------------------------------------------------


def registers_page() -> str:
    """Return the page of the node's register map."""
    from hdbench.devices.node.registers import MAP, PROTOCOL_VERSION

    rows = [
        "| address | registers | type | access | name | meaning |",
        "|---|---|---|---|---|---|",
    ]
    rows += [
        f"| 0x{entry.address:04X} | {entry.size} | {entry.kind} "
        f"| {'rw' if entry.writable else 'r'} "
        f"| `{entry.name}` | {cell(entry.meaning)} |"
        for entry in sorted(MAP, key=lambda entry: entry.address)
    ]
    return (
        MADE + f"# Register map\n\nHolding registers of a bench controller node, protocol version "
        f"{PROTOCOL_VERSION}: address from 0, big-endian, most significant word first; f32 is IEEE "
        "754, text is 16 bytes filled with NUL. How they work together: "
        "[node protocol](../node-protocol.md).\n\n" + "\n".join(rows) + "\n"
    )


PAGES = {
    "commands.md": commands_page,
    "profile.md": profile_page,
    "exit-codes.md": exit_page,
    "results.md": results_page,
    **{f"{kind}.schema.json": partial(schema_file, kind) for kind in KINDS},
    "registers.md": registers_page,
}


# kept in the project: read where there is no site; the others are made with it
KEPT = "profile.md"


def main() -> int:
    """Write the pages, or say that the kept one is stale."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--write", metavar="FOLDER", nargs="?", type=Path, const=FOLDER, help="write the pages"
    )
    folder = parser.parse_args().write
    if folder is None:
        page = FOLDER / KEPT
        if page.is_file() and page.read_text(encoding="utf-8") == text_of(KEPT):
            return 0
        print(f"{page} is not what the code says; run: python tools/docs_reference.py --write")
        return 1
    folder.mkdir(parents=True, exist_ok=True)
    for name in PAGES:
        (folder / name).write_text(text_of(name), encoding="utf-8")
    return 0


def text_of(name: str) -> str:
    """Return the text of one page."""
    return PAGES[name]().rstrip("\n") + "\n"


if __name__ == "__main__":
    sys.exit(main())
