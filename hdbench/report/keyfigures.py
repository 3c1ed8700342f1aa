"""Key figures of any result: what a table over many runs shows of each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from hdbench.report import misalignment, ripple
from hdbench.report.calibration import section as calibration
from hdbench.report.diagnosis import section as diagnosis
from hdbench.report.pagemodel import KeyNumber, key_number
from hdbench.report.source import typed_result

KINDS = {
    "calibration": calibration,
    "misalignment": misalignment,
    "ripple": ripple,
    "diagnosis": diagnosis,
}
# entries that say how a result was asked for, not what came out
_ASKED = ("profile", "input", "inputs", "settings", "filter", "files", "proposal")
_CAUSE = re.compile(r"causes\[(\d+)\]")


def key_figures(result: Mapping[str, Any]) -> tuple[KeyNumber, ...]:
    """Return the key figures of a result: for a run those of its report."""
    kind = "".join(str(result.get("schema", "")).split("/")[1:2])
    module = KINDS.get(kind)
    if module is None:
        return tuple(_plain(result))
    causes = [cause["name"] for cause in result.get("causes", ())]
    return tuple(
        replace(
            n, quantity=_CAUSE.sub(lambda found: f"causes[{causes[int(found[1])]}]", n.quantity)
        )
        for n in module.numbers(typed_result(kind, result, "result"), "")
    )


def _plain(result: Mapping[str, Any]) -> Iterator[KeyNumber]:
    for key, body in result.items():
        if key in _ASKED:
            continue
        below = body.items() if isinstance(body, Mapping) and "value" not in body else ()
        for name, entry in ((key, body), *((f"{key}.{k}", v) for k, v in below)):
            number = key_number(entry, name.replace("_", " "), name, "", name)
            if number is not None:
                yield number
