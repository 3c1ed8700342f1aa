"""Places of what an answer cannot name."""

__all__ = ["located"]

_NEAR = {
    "motor-order": {"motor-order", "frequency"},
    "output-order": {"output-order", "time"},
    "frequency": {"frequency", "time", "motor-order"},
    "time": {"time", "outliers", "variance"},
    "velocity": {"velocity", "torque"},
    "torque": {"torque", "velocity"},
    "variance": {"variance"},
    "outliers": {"outliers", "time", "variance"},
}
_PLACES = {
    "order-3.37": ("motor-order", 3.37),
    "order-8": ("motor-order", 8.0),
    "subharmonic-0.5": ("motor-order", 0.5),
}
_KEYS = {"motor-order": "order", "frequency": "frequency_hz"}


def located(truth, answer):
    """(unexplained in the right domain, error of the place in bounds or None)."""
    if not truth["hidden"]:
        return False, None
    effect = truth["hidden"][0]
    allowed = _NEAR.get(effect["domain"], {effect["domain"]})
    right = any(left["domain"] in allowed for left in answer["unexplained"])
    if effect["name"] not in _PLACES:
        return right, None
    domain, place = _PLACES[effect["name"]]
    found = [left["location"] for left in answer["unexplained"] if left["domain"] == domain]
    for cause in answer["causes"]:
        entry = cause.get("parameters", {}).get(_KEYS[domain])
        if entry is not None:
            found.append(entry["value"])
    if not found:
        return right, None
    # bound of an order whose amplitude is d sigmas, over R turns: sqrt(6) / (pi R d)
    bound = 6.0**0.5 / (3.14159265 * truth["turns"] * effect["d"])
    return right, min(abs(value - place) for value in found) / bound
