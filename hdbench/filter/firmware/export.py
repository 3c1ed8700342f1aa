"""Write a filter model as a folder of C99 source."""

from __future__ import annotations

import hashlib
import json
import math
from importlib import resources
from pathlib import Path

import hdbench
from hdbench.errors import DataError, StorageError
from hdbench.filter.assemble import state_space
from hdbench.filter.firmware.header import model_header
from hdbench.filter.firmware.vectors import vector_header
from hdbench.filter.model import FilterModel

__all__ = ["export_firmware"]

_KERNEL = (
    "filter.h",
    "filter_math.h",
    "filter_lanes.h",
    "filter_motion.h",
    "filter_phase.h",
    "filter_sincos.h",
    "filter_recurse.h",
    "filter_update.h",
    "filter_dispatch.h",
    "filter.c",
)
_ASSETS = ("example.c", "selftest.c", "target.c", "target.ld", "Makefile", "README.md")


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
    DataError
        If the period is out of its domain.
    StorageError
        If a file cannot be written.
    """
    if not 0.0 < sample_period_s < math.inf:
        raise DataError(
            f"the sampling period is {sample_period_s!r} s; needed: above 0",
            where="--period",
            fix="give the period of the controller's interrupt in seconds",
        )
    space = state_space(model)
    body = json.dumps(model.to_dict(), sort_keys=True)
    provenance = [
        f"model {model.name} from {source}",
        f"sha256 of the model {hashlib.sha256(body.encode()).hexdigest()}",
        f"hdbench {hdbench.__version__}",
        *(f"{what}: {origin}" for what, origin in model.provenance.items()),
    ]
    texts = {name: _text("hdbench.filter.kernel", name) for name in _KERNEL}
    texts |= {name: _text("hdbench.filter.firmware.assets", name) for name in _ASSETS}
    texts["hdb_model.h"] = model_header(
        space, sample_period_s=sample_period_s, provenance=provenance
    )
    texts["hdb_vectors.h"] = vector_header(space, sample_period_s)
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


def _text(package: str, name: str) -> str:
    parent, _, folder = package.rpartition(".")
    return (resources.files(parent) / folder / name).read_text(encoding="utf-8")
