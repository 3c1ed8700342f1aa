"""What each of several records says of a cause, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench_cli.numbers import with_uncertainty

__all__ = ["record_lines", "voice_lines"]


def voice_lines(cause: Mapping[str, Any]) -> list[str]:
    """Say which record speaks for a cause, and its sizes where records do not agree."""
    voices = cause.get("records") or ()
    if not voices:
        return []
    said = ", ".join(f"{one['record']} {one['evidence_nats']:+.3g}" for one in voices)
    lines = [f"spoken for, nats: {said}"]
    apart = cause["disagreement"]["records"]
    if apart:
        lines.append(f"records disagree: {', '.join(apart)}")
        lines += [f"  {one['record']}: {_sizes(one)}" for one in voices]
    return lines


def _sizes(voice: Mapping[str, Any]) -> str:
    """Return the sizes of a cause in one record, without what an amplitude says too."""
    shown = [
        f"{name} {with_uncertainty({**entry, 'dof': None}, entry['unit'])}"
        for name, entry in voice["parameters"].items()
        if not name.startswith(("cosine", "sine", "phase")) and entry["std"] is not None
    ]
    return ", ".join(shown) or "does not show it"


def record_lines(result: Mapping[str, Any]) -> list[str]:
    """Say of each record what the extended model makes of it, or why it took no part."""
    return [_record_line(one, result) for one in result.get("records") or ()]


def _record_line(one: Mapping[str, Any], result: Mapping[str, Any]) -> str:
    if one["left_out"]:
        return f"{one['record']} left out: {one['left_out']}"
    before, after = (one[key]["heldout_rms_nm"] for key in ("simulated", "extended"))
    line = f"{one['record']}: held-out {before:.4g} -> {after:.4g} N m rms"
    material = [cause["name"] for cause in result["causes"] if cause["name"] in one["disagrees"]]
    if material:
        names = ", ".join(dict.fromkeys(material))
        line += f"; disagrees about {names}: another drive, or another state of it?"
    return line
