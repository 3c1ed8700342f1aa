"""Firmware: a filter model as C99 source, the kernel's own, with numbers, vectors and self-test."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path

import numpy as np

import hdbench
from hdbench.errors import StorageError
from hdbench.filter.kalman import PRIOR, block_rows, new_state, pack, run
from hdbench.filter.model import FilterModel
from hdbench.records import FloatArray

_ASSETS = ("example.c", "selftest.c", "target.c", "target.ld", "Makefile", "README.md")
_KINDS = (
    "HDB_OSCILLATOR",
    "HDB_RANDOM_WALK",
    "HDB_INTEGRATED_WALK",
    "HDB_ORNSTEIN_UHLENBECK",
    "HDB_MATERN",
    "HDB_RESONANCE",
)
_PARTS = ("HDB_RIPPLE", "HDB_MISALIGNMENT", "HDB_SLOW")
_SAMPLES = 600
_TOLERANCE_NM = 1e-3  # a float carries 24 bits; the acceptance of ten minutes at 1 kHz


def export_firmware(
    model: FilterModel, folder: Path, *, sample_period_s: float, source: str
) -> dict[str, str]:
    """Write source, numbers, example, test vectors and self-test of a model.

    Parameters
    ----------
    model : FilterModel
        The model. It turns with the velocity, also where it would use a measured angle.
    folder : Path
        Folder to write; made where it is not there. Files of these names are overwritten.
    sample_period_s : float
        Period of the controller's interrupt, s, > 0.
    source : str
        Where the model is from: preset or file.

    Returns
    -------
    dict of str to str
        SHA-256 of every file written, by name.

    Raises
    ------
    StorageError
        If a file cannot be written.
    """
    packed = pack(model)
    body = json.dumps(model.to_dict(), sort_keys=True)
    provenance = [
        f"model {model.name} from {source}",
        f"sha256 of the model {hashlib.sha256(body.encode()).hexdigest()}",
        f"hdbench {hdbench.__version__}",
        *(f"{what}: {origin}" for what, origin in model.provenance.items()),
    ]
    texts = {"filter.h": _text("kernel", "filter.h"), "filter.c": _one_file("filter.c")}
    texts |= {name: _text("firmware/assets", name) for name in _ASSETS}
    texts["hdb_model.h"] = model_header(
        packed, sample_period_s=sample_period_s, provenance=provenance
    )
    texts["hdb_vectors.h"] = vector_header(packed, sample_period_s)
    texts["README.md"] = texts["README.md"].replace("@PROVENANCE@", "\n".join(provenance))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise StorageError(
            f"cannot write: {error.strerror}", where=str(folder), fix="choose another folder"
        ) from error
    return {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}


def _text(folder: str, name: str) -> str:
    return (resources.files("hdbench.filter") / folder / name).read_text(encoding="utf-8")


def _one_file(name: str) -> str:
    """Return a source of the kernel with its parts in place; `filter.h` stays apart."""
    return re.sub(
        r'^#include "(filter_\w+\.h)"\n',
        lambda found: _one_file(found[1]),
        _text("kernel", name),
        flags=re.MULTILINE,
    )


def real(value: float) -> str:
    """Return a number as C source, exact in both builds."""
    return "(hdb_real)NAN" if value != value else f"(hdb_real){value:.17g}"


def _filled(text: str, **values: object) -> str:
    """Return a template with its @NAMES@ replaced."""
    for name, value in values.items():
        text = text.replace(f"@{name.upper()}@", str(value))
    return text


def model_header(packed: FloatArray, *, sample_period_s: float, provenance: Iterable[str]) -> str:
    """Return the header that fixes a model at compile time."""
    oscillators, slow = int(packed[0]), int(packed[1])
    r, inertia, ratio, constant, gate, gate_samples = map(real, packed[2:8].tolist())
    return _filled(
        _text("firmware/assets", "hdb_model.h"),
        provenance="\n".join(f" *   {_plain(line)}" for line in provenance),
        oscillators=oscillators,
        slow=slow,
        blocks=oscillators + slow,
        max_slow=max(slow, 1),
        period=real(float(np.float32(sample_period_s))),
        r=r,
        inertia=inertia,
        ratio=ratio,
        constant=constant,
        gate=gate,
        gate_samples=gate_samples,
        prior_start=int(packed[8]),
        block_rows="\n".join(line for row in block_rows(packed) for line in _block(row)),
    )


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


def check_samples(n: int, sample_period_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return samples: start from rest, reversal, standstill, missing samples, a spike."""
    time = np.arange(n, dtype=np.float64) * float(np.float32(sample_period_s))
    share = np.arange(n) / n
    velocity = 156.0 * np.sin(2.0 * np.pi * 1.5 * share)
    velocity[(share > 0.4) & (share < 0.5)] = 0.0
    angle = np.concatenate([[0.0], np.cumsum(velocity[:-1] * np.diff(time))])
    torque = 0.4 * np.cos(2.0 * angle + 0.6) + 0.2 * np.cos(4.0 * angle - 1.1)
    torque += 0.9 * np.cos(0.01 * angle + 0.3)
    # noise that needs no generator: the fractional parts of multiples of the golden ratio
    torque += 0.05 * np.sqrt(12.0) * (np.arange(n) * 0.6180339887498949 % 1.0 - 0.5)
    torque[n // 3 : n // 3 + n // 100] = np.nan
    torque[n // 5] += 20.0
    exact = [values.astype(np.float32).astype(np.float64) for values in (velocity, torque)]
    return time, exact[0], exact[1]


def unresolved_tolerance_nm(packed: FloatArray) -> float:
    r"""Return how far a float may be off while it still finds out what the torque is made of.

    Notes
    -----
    A float rounds the variance :math:`P_0` known before the data by :math:`2^{-24} P_0` in each of
    the n blocks' sums. Once the data leave R of it, the gain is wrong by the share
    :math:`n 2^{-24} P_0 / R`, which moves the estimate by that share of :math:`\sqrt R`:
    :math:`n 2^{-24} P_0 / \sqrt R`, added to what is allowed afterwards.
    """
    rows = block_rows(packed)
    before = max(row[PRIOR] for row in rows)
    return _TOLERANCE_NM + len(rows) * 2.0**-24 * before / math.sqrt(float(packed[2]))


def vector_header(packed: FloatArray, sample_period_s: float) -> str:
    """Return the header with test vectors of a model."""
    time, velocity, torque = check_samples(_SAMPLES, sample_period_s)
    answer = run(packed, new_state(packed), (time, velocity, torque, None))
    lines = []
    for name, values in (
        ("velocity", velocity),
        ("torque", torque),
        ("filtered", answer.torque_filtered_nm),
        ("variance", answer.innovation_variance_nm2),
    ):
        lines.append(f"static const hdb_real hdb_vector_{name}[HDB_VECTORS] = {{")
        lines += [f"    {real(value)}," for value in values.tolist()]
        lines += ["};", ""]
    lines += ["static const unsigned char hdb_vector_flag[HDB_VECTORS] = {"]
    lines += [*(f"    {value}," for value in answer.flags.tolist()), "};", ""]
    return _filled(
        _text("firmware/assets", "hdb_vectors.h"),
        samples=_SAMPLES,
        tolerance=real(_TOLERANCE_NM),
        unresolved=real(unresolved_tolerance_nm(packed)),
        arrays="\n".join(lines),
    )
