"""Limits of a diagnosis: samples that took no part, what is left, names that cannot show."""

from __future__ import annotations

from hdbench.results import DiagnosisResult

# a rest within 5 % of the noise is within what its two estimates differ by
_ABOVE = 1.05


def left_out_line(result: DiagnosisResult) -> str:
    """Say how many samples took no part and why; nothing where all did."""
    left = [one for one in result.left_out if one.samples]
    if not left:
        return ""
    total = round(left[0].samples / left[0].share)
    samples = sum(one.samples for one in left)
    if len(left) == 1:
        why = left[0].reason
    else:
        why = ", ".join(f"{one.reason} ({_count(one.samples)})" for one in left)
    share = f"{100.0 * samples / total:.2g} %"
    return f"{_count(samples)} of {_count(total)} samples ({share}): {why}"


def rest_line(result: DiagnosisResult) -> str:
    """Say what the model leaves above the noise and where; nothing where it leaves noise."""
    rest = result.rest
    if rest is None or not rest.heldout_rms_nm > _ABOVE * rest.noise_rms_nm:
        return ""
    axes = [" and ".join(x for x in (one.domain, one.second_domain) if x) for one in rest.told]
    where = f"unexplained at {', '.join(dict.fromkeys(axes))}" if axes else "not located"
    return f"{rest.heldout_rms_nm:.3g} N m left in noise of {rest.noise_rms_nm:.3g} N m: {where}"


def hidden_names(result: DiagnosisResult) -> dict[str, list[str]]:
    """Return the names that the record cannot show by reason, the most frequent one first."""
    hidden: dict[str, list[str]] = {}
    for one in result.testable:
        if not one.testable:
            # what stands behind a semicolon is of this name alone
            hidden.setdefault(one.because.partition(";")[0], []).append(one.name)
    return dict(sorted(hidden.items(), key=lambda item: -len(item[1])))


def _count(number: int) -> str:
    """Return a whole number in groups of three digits."""
    return f"{number:,}".replace(",", " ") if number > 9999 else str(number)
