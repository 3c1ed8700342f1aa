"""One record on one line."""

__all__ = ["one_line"]


def _cause(cause):
    extra = "".join(f"~{name}" for name in cause.get("group", ())[1:])
    rivals = "".join(f" or {name}" for name in cause.get("rivals", ()))
    return f"{cause['name']}{extra}{rivals}"


def one_line(truth, entry, verdict):
    """Hidden, answered, scored, seconds and megabytes."""
    hidden = " + ".join(
        f"{e['name']} {e['tier']}" + (f" d={e['d']:.1f}" if e["d"] else "") for e in truth["hidden"]
    )
    hidden = hidden or truth["fault"] or "clean"
    group = " ".join(
        "{" + ",".join(sorted(n for n, v in e["alike"].items() if v < 0.01)) + "}"
        for e in truth["hidden"]
    )
    answer = entry.get("answer")
    if answer is None:
        said = entry.get("refused") or entry.get("crashed")
    else:
        left = [f"?{u['domain']}@{u['location']:.4g}" for u in answer["unexplained"]]
        flags = sorted({f"!{f['name']}" for f in answer.get("data_flags", ())})
        minor = [f"({c['name']})" for c in answer.get("minor", ())]
        said = "; ".join([*map(_cause, answer["causes"]), *left, *minor, *flags]) or "nothing"
    marks = [
        word
        for word, is_set in (
            ("EXACT", verdict.exact),
            ("covered", verdict.covered and not verdict.exact),
            ("WRONG-CERTAIN", verdict.wrong_certain),
            ("alarm", verdict.alarm and not truth["hidden"] and not truth["fault"]),
            ("TOLD", verdict.fault_told),
            ("missed", bool(truth["hidden"]) and not verdict.alarm),
        )
        if is_set
    ]
    away = " ".join(f"{p}:{z:+.2f}" for _, p, z, _ in verdict.deviations)
    return (
        f"{truth['key']} [{truth['record']} {truth['noise']} {truth['sigma_nm']}] {hidden} {group}"
        f" -> {said} | {' '.join(marks) or '-'} {away} | {entry['seconds']:.1f} s "
        f"{entry['peak_mb']:.0f} MB"
    )
