"""Search: what a record holds beyond its baseline, one cause at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hdbench.diagnosis.discovery.channel import DELAY, LOW_PASS_PRICE, best_delay, start_fit
from hdbench.diagnosis.discovery.dictionary import Dictionary, Look, make_dictionary
from hdbench.diagnosis.discovery.fit import Beside, Fit
from hdbench.diagnosis.discovery.form import (
    STRONG,
    FormMove,
    attach_forms,
    best_form_move,
    form_cost,
    renew_channel,
)
from hdbench.diagnosis.discovery.joint import (
    LEAST_NATS,
    all_possible,
    best_formed,
    best_joined,
    impossible_parts,
    joined,
    on_simulated,
    renew,
    reshaped,
    stepped,
    value_of,
)
from hdbench.diagnosis.discovery.lines import (
    Scan,
    modulated_looks,
    plan_scans,
    scan_looks,
    scan_power,
    step_look,
)
from hdbench.diagnosis.discovery.loudness import loudness_beside, loudness_of
from hdbench.diagnosis.discovery.moments import solve, solve_best
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.refine import (
    Candidate,
    candidate_of,
    gain_of,
    log_evidence,
    price,
    refined,
    weighed,
)
from hdbench.diagnosis.discovery.tables import is_table, table_causes
from hdbench.diagnosis.discovery.term import (
    Term,
    follows_motion,
    is_line,
    is_other_torque,
    same_torque,
)
from hdbench.diagnosis.evidence import RIVAL_NATS, SPANS, chi2_tail
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

# share of the false-alarm rate of each kind of look
SHARES = {"name": 0.5, "line": 0.28, "step": 0.05, "table": 0.14, "burst": 0.03}
# looks of each kind that are weighed in one round; of pairs twice as many, of which so many stay
_NAMES, _LINES, _TABLES, _PAIRS = 5, 8, 2, 3
# a look this many nats behind the best cannot overtake it by a better shape or noise
_BEHIND = 0.5
_BEHIND_NATS = 15.0
# rounds of a search that finds ever more, and small causes in a row that end it
_MOST_ROUNDS, _SMALL = 30, 2
# evidence that a cause must keep where slow noise, which imitates it, is accepted after it
_IN_SLOW_NATS = 8.0
# a law of the motion goes first where it has at least one half of the evidence of a line
_LAWS_FIRST = 2.0
# rounds in which the noise without a candidate is fitted: a candidate must not gain by what its
# noise alone would have gained
_BASE_ROUNDS = 6
# a gain that the noise, fitted again, cannot give by chance: only then may it speak for a candidate
# that the present noise hides
_PLAIN_NATS = 20.0
# slow noise has some two parameters of its own
SLOW_PRICE = 4.0
# a name that was dropped this often beside others is not tried again
_AGAIN = 2
# what a second name costs that comes with another one: it is one of some fifty
SECOND_PRICE = 4.0
# changes of form errors in a row
_FORM_MOVES = 12
# entries of a round that are fitted with their form errors
_JOINED = 3


@dataclass(slots=True)
class Search:
    """State of a search.

    Parameters
    ----------
    fit : Fit
        Joint fit.
    names, tables : Dictionary
        Names of the catalogue, and tables.
    scans : tuple of Scan
        Axes of lines.
    causes : mapping
        Catalogue by name.
    alpha : float
        Probability of any finding without an effect.
    catalogue : mapping of str to Cause
        All causes by name, those that are no torque among them.
    """

    fit: Fit
    names: Dictionary
    tables: Dictionary
    scans: tuple[Scan, ...]
    causes: Mapping[str, Cause]
    alpha: float
    catalogue: Mapping[str, Cause]
    dropped: dict[str, int] = field(default_factory=dict)
    log: list[str] = field(default_factory=list)
    latest: tuple[str, ...] = ()
    first: dict[str, FloatArray] = field(default_factory=dict)
    first_power: float = 0.0
    most_nats: float = 0.0
    least_share: float = 0.0
    whole: Fit | None = None

    @property
    def told(self) -> Fit:
        """The fit with tables in what no name explains; without them before they were sought."""
        return self.whole or self.fit

    def _views(self) -> list[Fit]:
        """Return the fit, and the same in a noise that does not rise towards 0 Hz."""
        flat = self.fit.flat_view()
        return [self.fit] if flat is None else [self.fit, flat]

    def looks(self, beside: Beside) -> list[Look]:
        """Return the names that explain most of a residual and are worth weighing."""
        held, found = self._present(), dict[str, Look]()
        for look in self.names.looks(beside):
            if look.term.name not in found and is_other_torque(look.term.cause, held):
                found[look.term.name] = look
                if len(found) == _NAMES:
                    break
        return list(found.values())

    def _present(self) -> list[Cause]:
        """Return the causes of the fit, known ones among them."""
        return [part.term.cause for part in self.fit.parts if part.term is not None]

    def _places(self) -> list[tuple[str, Look]]:
        """Return lines and the best step."""
        found = [("line", look) for look in scan_looks(self.fit, self.scans, self.causes)]
        if "zero-step" in self.causes:
            step = step_look(self.fit, self.causes["zero-step"])
            if step is not None:
                found.append(("step", step))
        return found

    def _table_looks(self) -> list[tuple[str, Look]]:
        """Return the tables that explain most; an axis that is told once says no more."""
        held = {part.name for part in self.fit.parts}
        beside = self.fit.beside()
        looks = [*self.tables.looks(beside), *modulated_looks(self.fit, beside, self.scans)]
        best: dict[str, Look] = {}
        for look in sorted(looks, key=_quick, reverse=True):
            if look.term.name not in held:
                best.setdefault(look.term.name, look)
        return [("table", look) for look in list(best.values())[:_TABLES]]

    def round(self) -> tuple[Candidate, ...]:
        """Return the best candidate, or pair, that passes the false-alarm rate; empty for none."""
        views = [view.beside() for view in self._views()]
        looks = [self.looks(view) for view in views]
        passing = self._passing([*(("name", x) for x in looks[0]), *self._places()])
        beside, base = views[0], settled(views[0], self.fit)
        tried = self._weighed(passing, beside, base)
        for view, some in zip(views, looks, strict=True):
            if passing or any(0.5 * x.statistic > _PLAIN_NATS for x in some):
                tried += self._pairs(view, beside, base, some)
        accepted = self._accepted(tried)
        self.most_nats = max((_plain(e) for e in accepted), default=0.0)
        return max(accepted, key=_turn, default=())

    def find_tables(self) -> None:
        """Find tables in what no name explains; names and their parameters stay as they are."""
        names, self.fit = self.fit, self.fit.copy()
        while True:
            beside = self.fit.beside()
            looks = self._passing(self._table_looks())
            base = settled(beside, self.fit)
            found = max(self._accepted(self._weighed(looks, beside, base)), key=_turn, default=())
            if not found:
                break
            before, without = self.fit.bands.power(self.fit.residual).sum(), self.fit.copy()
            self.accept(_unjoined(found))
            share = self.explained(before)
            if share < 0.0:
                # what it says of fast changes costs more of slow ones, where noise may be anything
                self.fit = without
            # further ones explain less
            if share < self.least_share:
                break
        self.whole, self.fit = self.fit, names

    def _passing(self, looks: list[tuple[str, Look]]) -> list[tuple[str, Look]]:
        """Return the nearest looks if any of them passes its share of the false-alarm rate."""
        if not any(x.false_alarm < self.alpha * SHARES[kind] for kind, x in looks):
            return []
        return _nearest(looks)

    def _weighed(
        self, looks: list[tuple[str, Look]], beside: Beside, base: float
    ) -> list[tuple[Candidate, ...]]:
        """Return looks at their best shapes with their evidence."""
        out: list[tuple[Candidate, ...]] = []
        for kind, look in looks:
            chance = min(1.0, look.false_alarm / SHARES[kind])
            start = candidate_of(beside, self.fit.record, look.term, look.trials, chance)
            shaped = refined(beside, self.fit.record, start)
            out.append((_light(weighed(beside, self.fit.record, shaped, self.fit.shapes, base)),))
        return out

    def _accepted(self, tried: list[tuple[Candidate, ...]]) -> list[tuple[Candidate, ...]]:
        """Return the entries that pass, fitted with their form errors where they are strong."""
        passed: list[tuple[Candidate, ...]] = []
        for entry in map(self._judged, self._joined(self._different(tried))):
            if entry[0].false_alarm < self.alpha and _nats(entry) > needed_nats(entry[0].term):
                # of the fits only that of the best entry is kept: each is as large as the record
                best = max((*passed, entry), key=_turn)
                passed = [e if e is best else _unjoined(e) for e in (*passed, entry)]
        words = [f"{'+'.join(c.name for c in e)} {_nats(e):.0f} of {_plain(e):.0f}" for e in passed]
        self.log.append("  " + "; ".join(words[:6]))
        return passed

    def _different(self, tried: list[tuple[Candidate, ...]]) -> list[tuple[Candidate, ...]]:
        """Return the best entry of each set of names, without names that were dropped often."""
        best: dict[tuple[object, ...], tuple[Candidate, ...]] = {}
        for entry in sorted(tried, key=_plain, reverse=True):
            if all(self.dropped.get(c.name, 0) < _AGAIN for c in entry):
                place = _identity(entry[0].term) if is_line(entry[0].term.cause) else ()
                best.setdefault((*sorted(c.name for c in entry), *place), entry)
        return list(best.values())

    def _joined(self, ranked: list[tuple[Candidate, ...]]) -> Iterator[tuple[Candidate, ...]]:
        """Yield entries, the likeliest strong ones with the evidence that form errors give them."""
        chosen = []
        for place, entry in enumerate(ranked):
            if place < _JOINED and entry[0].gain_nats * entry[0].loud > 0.5 * STRONG:
                chosen.append(entry)
            else:
                yield entry
        if not chosen:
            return
        base = max(
            settled(self.fit.beside(), self.fit) - form_cost(self.fit),
            value_of(joined(self.fit, ())),
        )
        for entry in chosen:
            new, terms = best_joined(self.fit, tuple(c.term for c in entry), hidden=True)
            if not all_possible(new, len(terms)):
                continue
            places = list(range(len(new.parts) - len(terms), len(new.parts)))
            least, loud = entry[0].gain_nats * entry[0].loud, loudness_of(new, places)
            gain = max(value_of(new) - base, least) / loud
            cost = entry[0].gain_nats - entry[0].evidence_nats
            better = replace(
                entry[0], gain_nats=gain, evidence_nats=gain - cost, joined=new, loud=loud
            )
            found = (better, *entry[1:])
            yield tuple(replace(c, term=t) for c, t in zip(found, terms, strict=True))

    def _judged(self, entry: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
        """Return an entry with the chance of its gain in likelihood where that is smaller."""
        first = entry[0]
        if _has_place(first.term) or first.gain_nats < _PLAIN_NATS:
            # tails fall like exp(-T / 2), and T is so many times too large
            louder = first.false_alarm ** (1.0 / first.loud)
            return tuple(replace(c, false_alarm=louder) for c in entry)
        table = is_table(first.term.cause)
        every = (self.tables if table else self.names).all_trials
        trials = float(np.prod([c.trials * every for c in entry]))
        chance = chi2_tail(2.0 * max(first.gain_nats, 0.0), max(sum(c.dof for c in entry), 1))
        chance = min(1.0, chance * trials / SHARES["table" if table else "name"])
        return tuple(replace(c, false_alarm=min(c.false_alarm, chance)) for c in entry)

    def _pairs(
        self, view: Beside, beside: Beside, base: float, looks: list[Look]
    ) -> list[tuple[Candidate, ...]]:
        """Return the most promising pairs of names in a view, weighed together beside the fit."""
        held = self._present()
        likely = [
            (one, other)
            for one, other in self.names.pairs(view, looks)
            if is_other_torque(one.term.cause, held)
            and is_other_torque(other.term.cause, (*held, one.term.cause))
        ]
        both_weighed = (pair_of(beside, self.fit, pair, base) for pair in likely[: 2 * _PAIRS])
        return [both for both in both_weighed if both[0].gain_nats > _PLAIN_NATS][:_PAIRS]

    def accept_slow(self, evidence: float) -> bool:
        """Accept slow noise where it explains more than anything else; return whether it does."""
        fit = self.fit
        if fit.shapes.with_slow:
            return False
        rising = fit.shapes.rising()
        base = solve_best(fit.moments(), fit.shapes, fit.spectrum).likelihood
        start = rising.fit(fit.spectrum.power, fit.bands.counts)
        tried = solve(fit.moments(), rising, start, rounds=4, anew=True, reference=fit.spectrum)
        price = SLOW_PRICE * max(1, len(fit.record.records))
        gain = tried.likelihood - base - price
        if gain < max(evidence, RIVAL_NATS) or gain < self._table_nats():
            return False
        self.log.append(f"slow noise E={gain:.0f}")
        before, dropped = fit.copy(), dict(self.dropped)
        fit.shapes = rising
        fit.settle(4, anew=True)
        self.prune(_IN_SLOW_NATS, 0)
        # causes that it imitates go, where it says as much as they did
        if _worth(fit) - price > _worth(before):
            return True
        self.log.append("the causes say more than slow noise")
        self.fit, self.dropped = before, dropped
        return False

    def _table_nats(self) -> float:
        """Return the most evidence that a table has in the noise as it is."""
        beside = self.fit.beside()
        looks = self._passing(self._table_looks())
        tried = self._weighed(looks, beside, settled(beside, self.fit))
        return max((_plain(entry) for entry in tried), default=0.0)

    def accept_delay(self, evidence: float) -> bool:
        """Accept a delay of the torque where it says more than anything else; return whether."""
        if self.fit.record.late_s != 0.0 or DELAY not in self.catalogue:
            return False
        found = best_delay(self.fit)
        chance = found.false_alarm * self.names.all_trials
        if found.evidence_nats < max(evidence, LEAST_NATS) or chance > self.alpha * SHARES["name"]:
            return False
        self.fit = found.fit
        self.fit.settle(2)
        self.log.append(f"delay {self.fit.record.late_s:.3g} s E={found.evidence_nats:.0f}")
        return True

    def retime(self) -> None:
        """Let a delay of the torque follow what was found; none where it is not needed now."""
        if self.fit.record.late_s == 0.0:
            return
        found = best_delay(self.fit)
        needed = self.fit.record.late_known or found.evidence_nats > LEAST_NATS
        self.fit = found.fit if needed else self.fit.retimed(0.0, 3)

    def accept(self, entry: tuple[Candidate, ...]) -> None:
        """Add candidates to the fit and settle."""
        old, new = self.fit, entry[0].joined
        self.latest = tuple(found.name for found in entry)
        if new is None:
            for found in entry:
                old.add_term(found.term)
            old.settle(3)
        else:
            self.fit = new
        for found, part in zip(entry, self.fit.parts[-len(entry) :], strict=True):
            part.false_alarm, part.trials = found.false_alarm, found.trials
            part.cost_nats = (entry[0].gain_nats - entry[0].evidence_nats) / len(entry)
            self.log.append(
                f"+ {found.name} {_short(found.term)} E={found.evidence_nats:.0f}"
                f" T={found.statistic:.0f}"
            )

    def change_form(self, move: FormMove) -> None:
        """Take over a change of form errors, without the causes that it makes needless."""
        fit = self.fit
        names = "+".join(fit.parts[index].name for index in move.scales)
        gone = "".join(f" -{fit.parts[index].name}" for index in move.needless)
        size = max(move.scales.values())
        self.log.append(f"form {names} {size} E={move.gain_nats:.0f}{gone}")
        for index, scale in move.scales.items():
            fit.parts[index].form_scale = scale
        for index in sorted(move.needless, reverse=True):
            fit.remove(index)
        fit.settle(3)

    def replace_term(self, part: int, own: Candidate, better: Candidate) -> bool:
        """Put a likelier name in the place of a cause; return whether the fit says so, too."""
        fit = self.fit
        new = joined(fit.without_view(part), (better.term,))
        new.parts[-1].form_scale = fit.parts[part].form_scale
        attach_forms(new)
        new.settle(2)
        new = best_formed(new, 1)
        own_cost, cost = (one.gain_nats - one.evidence_nats for one in (own, better))
        if (value_of(new) - value_of(fit)) / own.loud + own_cost < cost:
            return False
        held = new.parts[-1]
        held.false_alarm, held.trials = fit.parts[part].false_alarm, better.trials
        held.cost_nats = cost
        self.fit = new
        renew(new)
        return True

    def take_best_forms(self) -> None:
        """Let the latest causes have the likeliest form of their torque, of which a fit has one."""
        for name in self.latest:
            part = next((k for k in self.fit.causes() if self.fit.parts[k].name == name), None)
            if part is None or is_line(self.fit.term(part).cause):
                continue
            held, view = self.fit.parts[part], self.fit.without_view(part)
            cause, beside, tried = self.fit.term(part).cause, view.beside(), {name}
            for look in self.names.looks(beside):
                if look.term.name in tried or not same_torque(look.term.cause, cause):
                    continue
                tried.add(look.term.name)
                start = candidate_of(beside, view.record, look.term, look.trials, 1.0)
                new, _ = best_joined(view, (refined(beside, view.record, start).term,))
                new = best_formed(reshaped(new, new.causes()), len(new.parts))
                if all_possible(new, 1) and value_of(new) > value_of(self.fit) + RIVAL_NATS:
                    last = new.parts[-1]
                    last.false_alarm, last.trials = held.false_alarm, held.trials
                    last.cost_nats, self.fit = held.cost_nats, new
                    self.log.append(f"{last.name} for {name}")

    def explained(self, before: float) -> float:
        """Return the share of the baseline's residual power that was explained since `before`."""
        now = float(self.fit.bands.power(self.fit.residual).sum())
        return (before - now) / max(self.first_power, 1e-300)

    def reshape_all(self) -> None:
        """Refine the shapes of all accepted causes where that makes the fit likelier."""
        self.fit = stepped(self.fit, self.fit.causes())

    def reform_all(self) -> bool:
        """Let all laws have the shapes about which form errors are likeliest; return if any moved.

        This takes too long for every round.
        """
        before = value_of(self.fit)
        self.fit = reshaped(self.fit, self.fit.causes())
        return value_of(self.fit) > before + LEAST_NATS

    def prune(self, least: float | None = LEAST_NATS, most: int = 1) -> None:
        """Drop causes that the others, or another noise, made needless.

        `least` is the evidence that they need, nats; None for what the name of each needs.
        """
        fit = self.fit
        while len(fit.causes()) > most:
            gone = impossible_parts(fit)
            worst, spare = (max(gone), -np.inf) if gone else (None, 0.0)
            for part in () if gone else fit.causes():
                needed = needed_nats(fit.term(part)) if least is None else least
                value = self.evidence_of(part) - needed
                if value < spare:
                    # a name has its form error with it, which its evidence alone leaves out
                    value = max(value, self.lost_without(part) - needed)
                if value < spare:
                    worst, spare = part, value
            if worst is None:
                return
            self.log.append(f"- {fit.parts[worst].name} {-spare:.1f} short")
            name = fit.parts[worst].name
            again = _AGAIN if name in self.latest else self.dropped.get(name, 0) + 1
            self.dropped[name] = again
            fit.remove(worst)
            fit.settle(3)

    def lost_without(self, part: int) -> float:
        """Return what a fit loses without a cause, beyond what the cause costs, nats."""
        fit = self.fit
        without = fit.without(part)
        lost = value_of(fit) - value_of(best_formed(without, len(without.parts)))
        return lost / loudness_of(fit, [part]) - fit.parts[part].cost_nats

    def drop_needless(self) -> bool:
        """Drop causes that others at shapes of their own can stand for; return whether any went.

        Beside tables no name is needless: they could stand for any.
        """
        before = self.fit.causes()
        # from the last one on: the places before one that goes stay
        for part in reversed(self.fit.tables() or before):
            fit = self.fit
            held = fit.parts[part]
            self.fit = fit.without(part)
            self.reshape_all()
            attach_forms(self.fit)
            lost = value_of(fit) - value_of(best_formed(self.fit, len(self.fit.parts)))
            if lost > held.cost_nats:
                self.fit = fit
            else:
                self.log.append(f"- {held.name} lost {lost:.1f} cost {held.cost_nats:.1f}")
                self.dropped[held.name] = self.dropped.get(held.name, 0) + 1
        return len(self.fit.causes()) < len(before)

    def best_table(self, view: Fit, beside: Beside) -> Look | None:
        """Return the table that explains most beside a fit; None without one."""
        looks = [*self.tables.looks(beside)[:1], *modulated_looks(view, beside, self.scans)]
        looks = [look for look in looks if self.dropped.get(look.term.name, 0) < _AGAIN]
        return max(looks, key=_quick, default=None)

    def exchange_for_table(self) -> bool:
        """Take a table in place of laws that miss the torque's form; return whether any went."""
        for part in self.fit.causes():
            if part in self.fit.tables() or self.fit.term(part).cause.common:
                # what nearly every drive has stays, and a table stands beside it
                continue
            view = self.fit.without(part, *self.fit.tables())
            beside = view.beside()
            own = candidate_of(beside, view.record, self.fit.term(part), 1.0, 1.0)
            look = self.best_table(view, beside)
            if look is None or own.statistic > SPANS * look.statistic:
                continue
            new, both = joined(view, (look.term,)), joined(self.fit, (look.term,))
            if value_of(both) - value_of(new) > self.fit.parts[part].cost_nats:
                # what the table says is no part of the law
                continue
            found = candidate_of(beside, view.record, look.term, look.trials, look.false_alarm)
            if self._exchanged(new, found):
                return True
        return False

    def _exchanged(self, new: Fit, table: Candidate) -> bool:
        """Take a fit with a table last if the names that it makes needless are not likelier.

        The table says more than they do, so they must be likelier by 20 to 1.
        """
        fit = self.fit
        relieve(new)
        stay = [id(part.term) for part in new.parts[:-1]]
        gone = [part for part in fit.causes() if id(fit.parts[part].term) not in stay]
        if not gone:
            return False
        base = fit.without(*gone)
        beside = base.beside()
        table = candidate_of(beside, base.record, table.term, table.trials, table.false_alarm)
        table = weighed(beside, base.record, table, base.shapes, settled(beside, base))
        cost = table.gain_nats - table.evidence_nats
        names = value_of(fit) - sum(fit.parts[part].cost_nats for part in gone)
        gain = value_of(new) - cost - names
        self.log.append(
            f"{table.name} for {'+'.join(fit.parts[k].name for k in gone)} E={gain:.0f}"
            f" T={table.statistic:.0f}"
        )
        if gain < -RIVAL_NATS:
            return False
        for part in gone:
            name = fit.parts[part].name
            self.dropped[name] = self.dropped.get(name, 0) + 1
        self.accept((replace(table, joined=new),))
        return True

    def go_on(
        self, report: Callable[[str, float], None] | None = None, plain: Sequence[Fit] = ()
    ) -> tuple[int, Fit] | None:
        """Search until nothing passes, or one of `plain` is as good with the same causes.

        Returns which one, with the causes; None where none is.
        """
        small = 0
        for count in range(_MOST_ROUNDS):
            if report is not None:
                report("searching", 0.35 + 0.5 * (1.0 - 0.8**count))
            names, worth = _names(self.fit), _worth(self.fit)
            found = self.round()
            form = best_form_move(self.fit)
            most = max(self.most_nats, form.gain_nats if form else 0.0)
            if self.accept_slow(most) or self.accept_delay(most):
                continue
            least = max(_turn(found), LEAST_NATS)
            reformed = form is not None and form.gain_nats > least
            if reformed:
                self._change_forms(form, least)
            elif found:
                left = self.fit.bands.power(self.fit.residual).sum()
                self.accept(found)
                small = small + 1 if self.explained(left) < self.least_share else 0
                if small > _SMALL:
                    self.reform_all()
                    self.drop_needless()
                    break
            elif not (self.reform_all() or self.drop_needless()):
                break
            self.reshape_all()
            if found:
                self.take_best_forms()
            renew(self.fit)
            self.retime()
            renew_channel(self.fit)
            attach_forms(self.fit, idle=True)
            self.prune()
            gained = _names(self.fit) != names or _worth(self.fit) >= worth + LEAST_NATS
            if found and not (reformed or gained):
                # what was found has gone again, in whatever form
                self.dropped |= dict.fromkeys(self.latest, _AGAIN)
            for place, one in enumerate(plain):
                same = _with_causes(one, self.fit)
                if value_of(same) > value_of(self.fit) - LOW_PASS_PRICE:
                    return place, same
        return None

    def _change_forms(self, form: FormMove | None, least: float) -> None:
        """Take over changes of form errors as long as they gain more than the best candidate."""
        for _ in range(_FORM_MOVES):
            if form is None or form.gain_nats < least:
                return
            self.change_form(form)
            form = best_form_move(self.fit)

    def beside_names(self, part: int) -> Beside:
        """Return the fit beside a part; beside a name, without tables, which could take it in."""
        tables = self.fit.tables()
        return self.fit.beside(part, *(() if part in tables else tables))

    def evidence_of(self, part: int) -> float:
        """Return the evidence of an accepted cause beside all others, nats.

        For a name it is the larger one of that beside tables and that without them.
        """
        fit, tables = self.fit, self.fit.tables()
        views = [fit.beside(part)]
        if tables and part not in tables:
            views.append(self.beside_names(part))
        found = []
        for beside in views:
            trials = fit.parts[part].trials
            start = candidate_of(beside, fit.record, fit.term(part), trials, 0.0)
            base = settled(beside, fit)
            found.append(weighed(beside, fit.record, start, fit.shapes, base).evidence_nats)
        return max(found)


def relieve(fit: Fit) -> None:
    """Take out of a fit the causes that its last one makes needless."""

    def worth(part: int) -> float:
        kept = np.flatnonzero(fit.active & (fit.owner != part))
        lesser = solve(fit.moments(kept), fit.shapes, fit.spectrum, rounds=1)
        return fit.likelihood - lesser.likelihood - fit.parts[part].cost_nats

    while True:
        least, part = min(((worth(p), p) for p in fit.causes()[:-1]), default=(0.0, 0))
        if least >= 0.0:
            return
        fit.remove(part)
        fit.settle(2)


def _light(found: Candidate) -> Candidate:
    """Return a candidate without its rows, which are made anew where it is accepted."""
    return replace(found, rows=found.rows[:0].copy())


def _unjoined(entry: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
    """Return an entry without the fits that were made with it."""
    return tuple(replace(c, joined=None) if c.joined else c for c in entry)


def _has_place(term: Term) -> bool:
    """Return whether a term is a line or a step, which costs what was tried to find its place."""
    return is_line(term.cause) or "step_time_s" in term.shape


def needed_nats(term: Term) -> float:
    """Return the evidence that a cause must have, nats: odds of 20 to 1, and what its name costs.

    A table has no name, and a line or a step has paid for its place.
    """
    placed = _has_place(term) or is_table(term.cause)
    return RIVAL_NATS + (0.0 if placed else SECOND_PRICE)


def settled(beside: Beside, fit: Fit) -> float:
    """Return the log likelihood without a candidate, its noise settled further than with one."""
    return solve_best(beside.moments, fit.shapes, fit.spectrum, rounds=_BASE_ROUNDS).likelihood


def _turn(entry: tuple[Candidate, ...]) -> float:
    """Return evidence, doubled for what follows the motion: a true line loses nothing by waiting.

    A motion that repeats makes a law of speed look like lines over the angle, not the reverse.
    """
    law = all(follows_motion(c.term.cause) for c in entry)
    return round(_plain(entry) * (_LAWS_FIRST if law else 1.0), 1)


def _names(fit: Fit) -> list[str]:
    return sorted(fit.parts[part].name for part in fit.causes())


def _worth(fit: Fit) -> float:
    """Return the log likelihood of a fit less what its causes and their form errors cost."""
    return value_of(fit) - sum(fit.parts[part].cost_nats for part in fit.causes())


def _plain(entry: tuple[Candidate, ...]) -> float:
    """Return the evidence of an entry by the spectrum of the noise alone."""
    return sum(c.plain_nats for c in entry)


def _nats(entry: tuple[Candidate, ...]) -> float:
    """Return the evidence of an entry to a tenth: equals keep the order of the catalogue."""
    return round(sum(c.evidence_nats for c in entry), 1)


def pair_of(
    beside: Beside, fit: Fit, pair: tuple[Look, Look], base: float
) -> tuple[Candidate, ...]:
    """Return two names together: their joint evidence stands with the first."""
    one, other = (candidate_of(beside, fit.record, x.term, x.trials, 1.0) for x in pair)
    rows = np.concatenate([one.rows, other.rows])
    scale = np.concatenate([one.scale, other.scale])
    products = beside.products(rows)
    matrix, right, _ = beside.projected(products)
    amount = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    linear = amount / scale
    k = len(one.rows)
    one, other = replace(one, linear=linear[:k]), replace(other, linear=linear[k:])
    parameters = (*one.term.cause.linear, *other.term.cause.linear)
    gain, loud = 0.0, 1.0
    if all(p.contains(float(x)) for p, x in zip(parameters, linear, strict=True)):
        moving = any(follows_motion(x.term.cause) for x in pair)
        loud = loudness_beside(beside, rows, products, np.asarray(amount, dtype=np.float64))
        gain = gain_of(beside, products, fit.shapes, base, moving) / loud
    evidence = log_evidence(2.0 * max(gain, 0.0), len(rows)) - SECOND_PRICE
    evidence -= price(beside, fit.record, one) + price(beside, fit.record, other)
    return (
        replace(one, evidence_nats=evidence, gain_nats=gain, loud=loud),
        replace(other, evidence_nats=0.0, gain_nats=0.0),
    )


def _nearest(looks: list[tuple[str, Look]]) -> list[tuple[str, Look]]:
    """Return the looks that a better shape or noise may make the best."""
    # equals keep the order of the catalogue
    some = sorted(looks, key=lambda entry: -round(_quick(entry[1]), 1))
    best = _quick(some[0][1]) if some else 0.0
    least = best - max(_BEHIND_NATS, _BEHIND * best)
    return [entry for entry in some if _quick(entry[1]) > least][: _NAMES + _LINES]


def _identity(term: Term) -> tuple[str, tuple[tuple[str, float], ...]]:
    return term.name, tuple(term.shape.items())


def _quick(look: Look) -> float:
    return (
        0.5 * look.statistic
        - 2.0 * look.dof
        - float(np.log(max(look.trials, 1.0)))
        - (RIVAL_NATS if is_table(look.term.cause) else 0.0)
    )


def _short(term: Term) -> str:
    return ",".join(f"{v:.4g}" for v in term.shape.values())


def search(
    record: Record,
    causes: Mapping[str, Cause],
    known: tuple[Term, ...],
    *,
    alpha: float,
    rng: np.random.Generator,
    progress: Callable[[str, float], None] | None = None,
    least_share: float = 0.0,
) -> Search:
    """Return what a record holds beyond its baseline and the known causes."""
    report = progress or (lambda what, share: None)
    fit = start_fit(record, known)
    plain = [] if fit.record.low_pass is None else [start_fit(record.behind(None), known)]
    keys = (causes, known, alpha, rng, report, least_share)
    found = search_from(fit, plain, *keys)
    while not isinstance(found, Search):
        found = search_from(plain[0], (), *keys, found[1])
    return found


def _with_causes(fit: Fit, other: Fit) -> Fit:
    """Return a fit with the causes and the form errors of another one."""
    causes = other.causes()
    fit = joined(fit, [other.term(part) for part in causes])
    renew(fit)
    # a filter that runs once delays the torque, too
    fit = best_delay(fit).fit
    scales = {part.name: part.form_scale for part in other.parts}
    for part in fit.parts:
        part.form_scale = scales.get(part.name, 0.0)
    fit.settle(3)
    for own, its in zip(fit.causes(), causes, strict=True):
        new, old = fit.parts[own], other.parts[its]
        new.false_alarm, new.trials, new.cost_nats = old.false_alarm, old.trials, old.cost_nats
    return fit


def search_from(
    fit: Fit,
    plain: Sequence[Fit],
    causes: Mapping[str, Cause],
    known: tuple[Term, ...],
    alpha: float,
    rng: np.random.Generator,
    report: Callable[[str, float], None],
    least_share: float,
    start: Fit | None = None,
) -> Search | tuple[int, Fit]:
    """Return the search from a fit of the baseline, or from `start` with causes beyond it.

    `plain` are the same fits with one torque channel each that has no low-pass. Where one becomes
    as good with the same causes, its place and the fit with them are returned.
    """
    record = on_simulated(fit).record
    plain = [on_simulated(one) for one in plain]
    held = {term.name for term in known}
    usable = {
        name: cause
        for name, cause in causes.items()
        if cause.additive
        and name != DELAY
        and cause.applicable(record.motion) is None
        and (name not in held or is_line(cause) or name == "zero-step")
    }
    shared = (usable, alpha, causes, rng, least_share)
    state = _begun(fit, *shared, report)
    state.fit = start or fit
    found = state.go_on(report, plain)
    for place, one in enumerate(plain if found is None else ()):
        # a low-pass may be what a cause does to the torque: then that cause is not found beside it
        other = _begun(one, *shared)
        entry = other.round()
        if entry:
            other.accept(entry)
        if _worth(other.fit) > _worth(state.fit) - LOW_PASS_PRICE:
            return place, other.fit
    return found or state


def _begun(
    fit: Fit,
    usable: Mapping[str, Cause],
    alpha: float,
    causes: Mapping[str, Cause],
    rng: np.random.Generator,
    least_share: float,
    report: Callable[[str, float], None] = lambda what, share: None,
) -> Search:
    """Return a search that has not looked for anything yet."""
    record = fit.record
    attach_forms(fit, idle=True)
    report("forming the dictionary", 0.1)
    names = make_dictionary(record, usable.values(), fit)
    tables = make_dictionary(record, table_causes(record), fit)
    report("drawing the null", 0.3)
    names.calibrate(fit, rng)
    tables.calibrate(fit, rng)
    state = Search(fit, names, tables, plan_scans(record), usable, alpha, causes)
    state.first_power = float(fit.bands.power(fit.residual).sum())
    state.least_share = least_share
    state.first = {scan.domain: scan_power(fit, scan)[1] for scan in state.scans}
    return state
