"""Parameters of the answer against the truth, in bounds of Cramer and Rao."""

import math

__all__ = ["deviations"]

_LINE = (("amplitude_nm", "size", 1.0),)
# family: (parameter of the answer, truth's name, factor from the truth's unit to the answer's);
# a factor "per_s" divides by the record's length
_SAME = {
    "ripple-harmonic": (*_LINE, ("order", "order", 1.0)),
    "wave-generator-eccentricity": _LINE,
    "motor-unbalance": (("amplitude_nm", "size", 1.0 / 9.0),),
    "load-dependent-ripple": (("amplitude_nm", "size", 10.0),),
    "gain-ripple": (("amplitude_nm", "size", 10.0),),
    "torsional-resonance": (("resonance_hz", "resonance_hz", 1.0), ("damping", "damping", 1.0)),
    "tooth-mesh": _LINE,
    "bearing-defect": (("order", "order", 1.0),),
    "angular-misalignment": _LINE,
    "mains-hum": (*_LINE, ("frequency_hz", "frequency_hz", 1.0)),
    "structural-tone": (*_LINE, ("frequency_hz", "frequency_hz", 1.0)),
    "viscous-friction": (("viscous_nm_s_per_rad", "size", 1.0 / 400.0),),
    "gain-error": (("gain_error", "size", 1.0),),
    "cubic-nonlinearity": (("cubic_nm", "size", 0.064),),
    "direction-asymmetry": (("asymmetry", "size", 1.0),),
    "inertia-error": (("inertia_kg_m2", "size", 1.725e-2),),
    "time-skew": (("skew_s", "size", 1.0),),
    "zero-step": (("step_nm", "size", 1.0),),
    "zero-drift": (("drift_nm_per_s", "size", "per_s"),),
    "warm-up": (("rise_nm", "size", 1.0), ("time_constant_s", "constant_s", 1.0)),
    "creep": (("creep", "size", 1.0), ("time_constant_s", "constant_s", 1.0)),
    "crosstalk": (("crosstalk_nm_per_a", "size", 1.0),),
}


# the same for calibration loads; when a weight was hung between two readings nobody wrote down,
# so that the creep of injector and answer are not the same number
_STATIC = {
    "cubic-nonlinearity": (("cubic_nm", "size", 1.0 / 64.0),),
    "direction-asymmetry": (("asymmetry", "size", 1.0),),
    "zero-drift": (("drift_nm_per_s", "size", 1.0 / 3600.0),),
}


def deviations(truth, matched, causes):
    """((family, parameter, deviation / bound, deviation / stated standard deviation), ...)."""
    out = []
    known = _STATIC if truth["record"] == "loads" else _SAME
    for which, effect in enumerate(truth["hidden"]):
        if which not in matched or not effect["agrees"]:
            continue
        cause = causes[matched[which]]
        if cause["name"] != effect["name"]:
            continue
        for reported, name, factor in known.get(effect["name"], ()):
            entry = cause["parameters"].get(reported)
            if entry is None or name not in effect["bounds"]:
                continue
            factor = 1.0 / truth["seconds"] if factor == "per_s" else factor
            away = entry["value"] - factor * effect["values"][name]
            bound, std = factor * effect["bounds"][name], entry.get("std")
            if math.isfinite(away) and bound > 0.0:
                own = away / std if std else None
                out.append((effect["name"], reported, away / bound, own))
    return tuple(out)
