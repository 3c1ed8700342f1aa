"""Judge a diagnosis by the truth that only the injector knows."""

from dataclasses import dataclass

__all__ = ["Score", "score"]

_ORDER_NAMES = {
    "ripple-harmonic",
    "bearing-defect",
    "wave-generator-eccentricity",
    "motor-unbalance",
}
_TONE_NAMES = {"structural-tone", "mains-hum"}
_KEYS = {"order": "order", "tone": "frequency_hz"}
_DOMAINS = {"order": "motor-order", "tone": "frequency"}


@dataclass(frozen=True)
class Score:
    """What one answer is worth."""

    found: bool
    right_place: bool
    right_name: bool
    extra: int
    minor: int
    place_error: float


def _places(answer, hidden):
    """Places and names that the answer gives for the hidden kind."""
    key = _KEYS[hidden]
    out = []
    for cause in answer["causes"]:
        names = {cause["name"], *cause["group"], *cause["rivals"]}
        entry = cause["parameters"].get(key)
        if entry is not None:
            out.append((entry["value"], names))
        elif hidden == "order" and names & _ORDER_NAMES:
            out.append((1.0, names))
    for left in answer["unexplained"]:
        if left["domain"] == _DOMAINS[hidden]:
            out.append((left["location"], set()))
    return out


def score(injected, answer, resolution):
    """Score an answer (the contract's result object); `resolution` is one cell of the axis."""
    count = len(answer["causes"]) + len(answer["unexplained"])
    minor = len(answer["minor"]) + len(answer["minor_unexplained"])
    if injected.hidden == "clean":
        return Score(count > 0, False, False, count, minor, 0.0)
    if injected.hidden == "friction":
        right = any(
            "coulomb-friction" in {c["name"], *c["group"], *c["rivals"]} for c in answer["causes"]
        )
        return Score(count > 0, right, right, max(0, count - 1), minor, 0.0)
    places = _places(answer, injected.hidden)
    errors = [abs(value - injected.place) for value, _ in places]
    best = min(range(len(errors)), key=errors.__getitem__, default=None)
    names = _ORDER_NAMES if injected.hidden == "order" else _TONE_NAMES
    near = best is not None and errors[best] <= resolution
    named = near and bool(places[best][1] & names)
    error = errors[best] if best is not None else float("inf")
    return Score(count > 0, near, named, max(0, count - 1), minor, error)
