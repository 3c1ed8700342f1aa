"""Signatures of names of the catalogue on one record, as columns."""

import numpy as np

from .build import family_of, known_families
from .family import sign_curve, waves


def axes_of(scene):
    """Axes of the record by the domain of an answer."""
    path = scene.path
    return {
        "velocity": path.speed, "time": path.time, "output-order": path.output,
        "motor-angle": path.angle, "load": path.load, "torque": scene.tau,
        "acceleration": path.accel,
    }  # fmt: skip


def _number(parameters, name):
    entry = parameters.get(name)
    return None if entry is None else float(entry["value"])


def _free(scene, parameters):
    """Columns of a line at the place that the answer gives."""
    order, hertz = _number(parameters, "order"), _number(parameters, "frequency_hz")
    if order is not None:
        return [waves(m * order * scene.path.angle) for m in (1.0, 2.0, 3.0)]
    if hertz is not None:
        return [waves(2.0 * np.pi * hertz * scene.path.time)]
    return []


def signatures(scene, causes):
    """Columns of each reported name, generous: all shapes of its family at once.

    `causes` are (name, parameters) pairs; a name without a signature here is left out.
    """
    known = {family.name: family for family in known_families()}
    moving = sign_curve(scene.path.speed, 0.7)
    more = {
        "asymmetric-friction": [(moving**2)[:, None], np.abs(scene.path.speed)[:, None]],
        "zero-random-walk": [_hats(scene.path.time, 20)],
        "misalignment": [waves(scene.path.output)],
        "load-gravity": [waves(scene.path.output)],
        "side-force": [np.abs(scene.tau)[:, None]],
    }
    out = {}
    for name, parameters in causes:
        columns = [*_free(scene, parameters), *more.get(name, ())]
        at = _number(parameters, "time_s") or _number(parameters, "at_s")
        if name == "zero-step" and at is not None:
            columns.append((scene.path.time >= at).astype(float)[:, None])
        elif name in known and not columns:
            family = family_of(name)
            columns += [family.columns(scene, dict(entry)) for entry in family.grid(scene)]
        if columns:
            before = [out[name]] if name in out else []
            out[name] = np.column_stack([*before, *columns])
    return out


def _hats(values, count):
    places = np.linspace(values.min(), values.max(), count)
    return np.column_stack([np.interp(values, places, row) for row in np.eye(count)])
