"""Bad data: what a careless or broken bench hands over."""

import numpy as np

__all__ = ["FAULTS"]


def _span(columns, rng, low, high):
    count = len(columns["time_s"])
    length = int(rng.uniform(low, high) * 1000)
    first = int(rng.integers(count // 10, count - length - count // 10))
    return first, first + length


def _gaps(columns, rng):
    """Rows are missing; the clock column shows it."""
    keep = np.ones(len(columns["time_s"]), dtype=bool)
    places = []
    for _ in range(int(rng.integers(2, 6))):
        first, last = _span(columns, rng, 0.05, 1.5)
        keep[first:last] = False
        places.append([first / 1000.0, last / 1000.0])
    return {name: values[keep] for name, values in columns.items()}, {"places": places}


def _clipping(columns, rng):
    """The amplifier's range ends inside the signal."""
    volts = columns["torque_v"]
    limit = float(np.quantile(np.abs(volts - np.median(volts)), 0.985))
    middle = float(np.median(volts))
    clipped = np.clip(volts, middle - limit, middle + limit)
    return {**columns, "torque_v": clipped}, {"limit_v": limit}


def _slip(columns, rng):
    """The encoder's disc slips by a tenth to half of a turn."""
    first, _ = _span(columns, rng, 0.1, 0.2)
    name = "encoder_count" if "encoder_count" in columns else "motor_angle_rad"
    one_count = 1.0 if name == "encoder_count" else 2.0 * np.pi / 4000.0
    angle = columns[name].copy()
    angle[first:] += one_count * int(rng.integers(400, 2000))
    return {**columns, name: angle}, {"at_s": first / 1000.0}


def _units(columns, rng):
    """The torque channel is in millivolt."""
    return {**columns, "torque_v": columns["torque_v"] * 1000.0}, {"factor": 1000.0}


def _swapped(columns, rng):
    """Torque and tacho have changed places."""
    swap = {"torque_v": columns["tacho_v"], "tacho_v": columns["torque_v"]}
    return {**columns, **swap}, {}


def _stuck(columns, rng):
    """The torque channel stands still for a while."""
    first, last = _span(columns, rng, 0.5, 3.0)
    volts = columns["torque_v"].copy()
    volts[first:last] = volts[first]
    return {**columns, "torque_v": volts}, {"places": [[first / 1000.0, last / 1000.0]]}


def _loud_cell(columns, rng):
    """The brake's load cell has 3 mN m of noise of its own: no fault, but no exact load either."""
    if "load_torque_nm" not in columns:
        return columns, {}
    noise = 0.003 * rng.standard_normal(len(columns["time_s"]))
    return {**columns, "load_torque_nm": columns["load_torque_nm"] + noise}, {}


FAULTS = {
    "gaps": _gaps,
    "clipping": _clipping,
    "slip": _slip,
    "wrong-units": _units,
    "swapped-channel": _swapped,
    "stuck": _stuck,
    "noisy-load-cell": _loud_cell,
}
