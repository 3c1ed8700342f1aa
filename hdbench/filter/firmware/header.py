"""The C header of a filter model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from hdbench.filter.layout import BLOCK, MODEL_HEADER
from hdbench.filter.statespace import StateSpace, pack

__all__ = ["model_header", "real"]

_KINDS = (
    "HDB_OSCILLATOR",
    "HDB_RANDOM_WALK",
    "HDB_INTEGRATED_WALK",
    "HDB_ORNSTEIN_UHLENBECK",
    "HDB_MATERN",
    "HDB_RESONANCE",
)
_PARTS = ("HDB_RIPPLE", "HDB_MISALIGNMENT", "HDB_SLOW")


def real(value: float) -> str:
    """Return a number as C source, exact in both builds."""
    return "(hdb_real)NAN" if value != value else f"(hdb_real){value:.17g}"


def model_header(space: StateSpace, *, sample_period_s: float, provenance: Iterable[str]) -> str:
    """Return the header that fixes a model at compile time."""
    packed = pack(space).tolist()
    blocks = [packed[at : at + BLOCK] for at in range(MODEL_HEADER, len(packed), BLOCK)]
    oscillators, slow = int(packed[0]), int(packed[1])
    lines = [
        "/* Filter model, fixed at compile time. Written by `hdbench export`; do not edit.",
        *(f" *   {_plain(line)}" for line in provenance),
        " * Build with -DHDB_DOUBLE for double; else every number is a float. */",
        "#ifndef HDB_MODEL_H",
        "#define HDB_MODEL_H",
        "",
        "#ifndef HDB_DOUBLE",
        "#define HDB_SINGLE",
        "#endif",
        f"#define HDB_N_OSCILLATORS {oscillators}",
        f"#define HDB_N_SLOW {slow}",
        f"#define HDB_MAX_BLOCKS {oscillators + slow}",
        f"#define HDB_MAX_SLOW {max(slow, 1)}",
        f"#define HDB_SAMPLE_PERIOD_S ({real(float(np.float32(sample_period_s)))})",
        "#include <math.h>",
        "",
        '#include "filter.h"',
        "",
        "static const hdb_model hdb_exported_model = {",
        f"    .n_oscillators = {oscillators}, .n_slow = {slow},",
        f"    .r = {real(packed[2])}, /* (N m)^2 */",
        f"    .inertia = {real(packed[3])}, /* kg m^2 */",
        f"    .ratio = {real(packed[4])},",
        f"    .constant = {real(packed[5])}, /* s */",
        f"    .gate = {real(packed[6])}, .gate_samples = {real(packed[7])},",
        f"    .prior_start = {int(packed[8])},",
        "    .block = {",
        *(line for block in blocks for line in _block(block)),
        "    },",
        "};",
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Return text that cannot end a comment, in ASCII."""
    return text.replace("*/", "* /").encode("ascii", "replace").decode("ascii")


def _block(row: list[float]) -> list[str]:
    kind, part = _KINDS[int(row[0])], _PARTS[int(row[1])]
    order, omega, sample, rad, second, rate, variance, first, other = (real(v) for v in row[2:])
    return [
        f"        {{.kind = {kind}, .part = {part},",
        f"         .order = {order}, .omega = {omega},",
        f"         .q_sample = {sample}, .q_rad = {rad}, .q_s = {second},",
        f"         .rate = {rate}, .variance = {variance},",
        f"         .prior = {{{first}, {other}}}}},",
    ]
