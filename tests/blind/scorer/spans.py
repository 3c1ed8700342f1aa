"""Share of an effect that an axis, a pair of axes, or names of the catalogue span on a record."""

import itertools

import numpy as np

# samples at random that stand for the record: tables of some 200 columns use 3 % of them
_SAMPLES = 6000
_SIDE_LINES = 4
# a place told more widely than this, orders or Hz, says nothing about a line
_WIDEST = 0.05
# domains whose entries say when: an effect that is bursts is told by each of them
_MOMENTS = {"time", "outliers", "variance"}


def _rest(matrix, basis):
    return matrix - basis @ (basis.T @ matrix)


def _orthonormal(columns):
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, sizes > 1e-8 * max(sizes[0], 1e-30)] if len(sizes) else left


class Spanned:
    """One effect beside the baseline, at random samples of its record."""

    def __init__(self, effect, baseline, axes):
        pick = np.random.default_rng(len(effect)).permutation(len(effect))[:_SAMPLES]
        self.pick = np.sort(pick)
        self.axes = {name: values[self.pick] for name, values in axes.items()}
        self.seconds = float(np.ptp(axes["time"]))
        self.turns = float(np.ptp(axes["motor-angle"])) / (2.0 * np.pi)
        self._basis = _orthonormal(baseline[self.pick])
        self._left = _rest(effect[self.pick], self._basis)

    def share(self, columns):
        """Share of the effect's square that `columns` (already picked) take."""
        scale = np.abs(columns).max(axis=0)
        columns = columns[:, scale > 0.0] / scale[scale > 0.0]
        if not columns.size:
            return 0.0
        taken = _orthonormal(_rest(columns, self._basis))
        return float(np.sum((taken.T @ self._left) ** 2) / (self._left @ self._left))


def _hats(values, count):
    """Linear splines: knots at quantiles, and evenly."""
    even = np.linspace(values.min(), values.max(), count // 2)
    some = np.quantile(values, np.linspace(0.0, 1.0, count - count // 2))
    knots = np.unique(np.concatenate([even, some]))
    if len(knots) < 2:
        return np.ones((len(values), 1))
    return np.column_stack([np.interp(values, knots, row) for row in np.eye(len(knots))])


def _waves(angle, orders):
    return np.column_stack([wave(k * angle) for k in orders for wave in (np.cos, np.sin)])


def _lines(phase, entry, resolution, many):
    """Lines about the place of an entry: its extent, or some cells of resolution."""
    low, high = entry.get("extent") or (0.0, 0.0)
    width = max(_SIDE_LINES * resolution, min(_WIDEST, 0.5 * abs(high - low)))
    side = np.linspace(-width, width, 17) if many else np.zeros(1)
    return _waves(phase, float(entry.get("location") or 0.0) + side)


def _table(spanned, domain, entry, many):
    """Columns of a table over one axis, fine if `many`; None where the domain has no axis."""
    axes, knots = spanned.axes, 60 if many else 14
    if domain == "motor-order":
        return _lines(axes["motor-angle"], entry, 1.0 / max(spanned.turns, 1.0), many)
    if domain == "frequency":
        phase = 2.0 * np.pi * axes["time"]
        return _lines(phase, entry, 1.0 / max(spanned.seconds, 1.0), many)
    if domain == "motor-angle":
        return _waves(axes["motor-angle"], range(1, 25 if many else 10))
    if domain == "output-order":
        columns = _waves(axes["output-order"], range(1, 31 if many else 10))
        return np.column_stack([columns, _hats(axes["output-order"], knots)]) if many else columns
    if domain in axes:
        columns = [_hats(axes[domain], knots)]
        if domain in ("velocity", "acceleration"):
            columns.append(np.sign(axes[domain])[:, None])
        return np.column_stack(columns)
    return None


def _columns(spanned, entry, domains):
    singles = [_table(spanned, domain, entry, True) for domain in domains]
    if any(table is None for table in singles):
        return []
    if len(domains) == 2:
        one, two = (_table(spanned, domain, entry, False) for domain in domains)
        singles.append((one[:, :, None] * two[:, None, :]).reshape(len(one), -1))
    return singles


def axes_shares(spanned, entries, bursts):
    """Share of the effect by each axis or pair of axes that entries of `unexplained` tell.

    Entries on one axis count together: lines at several orders are one finding on that axis.
    """
    told = {}
    for entry in entries:
        domains = [entry["domain"], entry.get("second_domain")]
        domains = sorted({"time" if d in _MOMENTS else d for d in domains if d is not None})
        told.setdefault("|".join(domains), []).append((entry, domains))
    out = {}
    for key, some in told.items():
        columns = [c for entry, domains in some for c in _columns(spanned, entry, domains)]
        moments = bursts and "time" in key.split("|")
        out[key] = 1.0 if moments else spanned.share(np.column_stack(columns)) if columns else 0.0
    return out


def names_share(spanned, signatures):
    """Largest share that one name or two of them span, with those names, and that of each."""
    picked = {name: columns[spanned.pick] for name, columns in signatures.items()}
    each = {name: spanned.share(columns) for name, columns in picked.items()}
    best, who = 0.0, []
    for count in (1, 2):
        # the strongest alone are tried in pairs: twenty names are 190 of them
        names = sorted(each, key=each.get, reverse=True)[:8]
        for some in itertools.combinations(names, count):
            share = spanned.share(np.column_stack([picked[name] for name in some]))
            if share > best + 1e-9:
                best, who = share, list(some)
    return best, who, each
