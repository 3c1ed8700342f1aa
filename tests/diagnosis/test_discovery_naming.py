"""Groups, form errors and held-out gains of a fit, against brute force."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from discovery_records import NOISE_NM, fitted, prepared, swinging, term, with_terms
from swinging_shaft import reversing

from hdbench.diagnosis.discovery import form, naming, refine
from hdbench.diagnosis.discovery.channel import start_fit
from hdbench.diagnosis.discovery.dictionary import Dictionary, Look
from hdbench.diagnosis.discovery.form import FIXED, attach_forms, form_rows
from hdbench.diagnosis.discovery.heldout import Prediction, gain_between, hold_out
from hdbench.diagnosis.discovery.joint import (
    all_possible,
    best_joined,
    impossible_parts,
    is_within,
    joined,
    renew,
    reshaped,
    sized,
    stepped,
    value_of,
)
from hdbench.diagnosis.discovery.lines import TONE_LINE
from hdbench.diagnosis.discovery.loudness import loudness
from hdbench.diagnosis.discovery.naming import _is_plain, _named, _same_space
from hdbench.diagnosis.discovery.search import Search, _turn, relieve
from hdbench.diagnosis.discovery.stack import stack_fits, stacked_causes
from hdbench.diagnosis.discovery.tables import table_causes
from hdbench.diagnosis.discovery.term import Term, term_columns
from hdbench.diagnosis.discovery.told import (
    _spoils,
    distinct,
    place_of,
    predicting_delay,
    walk_of,
)
from hdbench.model import catalogue
from hdbench.results.diagnosis import Unexplained


@pytest.fixture(scope="module", name="beside")
def baseline():
    return fitted(swinging(3000)).beside()


def candidate(name, rows, nats=0.0):
    cause = SimpleNamespace(name="cause", shape=())
    return SimpleNamespace(
        name=name, rows=np.atleast_2d(rows), term=SimpleNamespace(cause=cause), evidence_nats=nats
    )


def own_rows(beside, count):
    """Return rows that are orthonormal in the noise beside what is explained."""
    rows = np.random.default_rng(2).standard_normal((count, beside.bands.size))
    weight = np.sqrt(beside.whitening)
    q = np.linalg.qr((beside.rows * weight).T)[0]
    white = rows * weight
    white = np.linalg.qr((white - (white @ q) @ q.T).T)[0].T
    return white / weight


def test_the_same_columns_in_other_units_and_turned_are_one_space(beside):
    rows = own_rows(beside, 2)
    turned = np.array([[3.0, 1.0], [-20.0, 40.0]]) @ rows
    assert _same_space(beside, candidate("one", rows), candidate("other", turned))


def test_what_the_baseline_explains_makes_no_difference(beside):
    (row,) = own_rows(beside, 1)
    other = 1e3 * row + beside.rows[0]
    assert _same_space(beside, candidate("one", row), candidate("other", other))


@pytest.mark.parametrize(("share", "same"), [(0.009, True), (0.011, False), (1.0, False)])
def test_a_hundredth_of_the_energy_parts_two_spaces(beside, share, same):
    a, b = own_rows(beside, 2)
    other = np.sqrt(1.0 - share) * a + np.sqrt(share) * b
    assert _same_space(beside, candidate("one", a), candidate("other", other)) is same


def test_groups_rivals_and_probability_of_a_table(beside):
    a, b, c, d = own_rows(beside, 4)
    table = [
        candidate("own", a, 20.0),
        candidate("twin", 2.0 * a, 19.0),
        candidate("near", b, 17.5),
        candidate("far", c, 16.5),
        candidate("near", d, 10.0),
    ]
    named = _named(beside, table)
    assert [one.name for one in named.group] == ["twin"]
    # within 3 nats: odds of 20 to 1
    assert [one.name for one in named.rivals] == ["near"]
    odds = np.exp([20.0, 19.0, 17.5, 16.5])
    assert named.probability == pytest.approx(odds[:2].sum() / odds.sum())


SIXTH = term("ripple-harmonic", order=6.0)


def held_out(extra, seed=0, n=6000):
    fit, part = with_terms(fitted(swinging(n, extra, seed)), SIXTH)
    held = hold_out(fit)
    base = set(range(len(fit.parts))) - {part}
    return held.predict(base), held.predict(base | {part}), fit, held


def test_held_out_errors_are_those_of_the_noise_with_and_without_a_cause():
    before, after, *_ = held_out(lambda t, a, w: 0.1 * np.cos(6.0 * a + 1.0))
    # scatter of an rms of 6000 samples is 0.9 %
    assert before.rms_nm == pytest.approx(np.hypot(NOISE_NM, 0.1 / np.sqrt(2.0)), rel=0.03)
    assert after.rms_nm == pytest.approx(NOISE_NM, rel=0.03)
    gain = gain_between(before, after, np.random.default_rng(0))
    wanted = 0.005 / (0.005 + NOISE_NM**2)
    assert gain.explained_fraction == pytest.approx(wanted, abs=0.02)
    assert gain.interval[0] < wanted < gain.interval[1]


def test_a_cause_that_is_not_there_gains_nothing_where_it_was_not_fitted():
    falls = []
    for seed in range(3):
        before, after, *_ = held_out(lambda t, a, w: 0.0, seed, 3000)
        falls.append(before.chi2 - after.chi2)
    # two free numbers cost 2 (1 + 1/4) of chi^2 held out, give or take 2 sqrt(2 * 2) each
    assert np.mean(falls) < 2.0


def test_held_out_blocks_are_predicted_as_by_plain_regression_on_the_others():
    _, after, fit, held = held_out(lambda t, a, w: 0.1 * np.cos(6.0 * a))
    record = fit.record
    n = len(record)
    columns = np.column_stack([record.columns, term_columns(SIXTH, record)])
    squares, folds, used = 0.0, np.arange(n) * 20 // n % 5, held.pieces[0].used
    for fold in range(5):
        # the noise is white: plain least squares
        train, test = folds != fold, (folds == fold) & used
        solution = np.linalg.lstsq(columns[train], record.response_nm[train], rcond=None)[0]
        squares += float(np.sum((record.response_nm[test] - columns[test] @ solution) ** 2))
    assert after.counts.sum() == used.sum()
    # the fitted spectrum is not quite white
    assert after.squares.sum() == pytest.approx(squares, rel=0.01)


def costly(fit, *terms):
    """Add terms that cost as much as names do; return the part of the last one."""
    parts = [fit.add_term(one) for one in terms]
    for part in parts:
        fit.parts[part].cost_nats = 6.0
    fit.settle(3)
    return parts[-1]


def table_of(fit):
    return next(one for one in table_causes(fit.record) if one.name == "table:velocity")


def searching(fit):
    none = Dictionary((), np.zeros((0, fit.bands.size), dtype=np.float32), [])
    return Search(fit, none, none, (), catalogue(), 0.01, catalogue())


@pytest.mark.parametrize(("viscous", "left"), [(0.0, ()), (2e-3, ("viscous-friction",))])
def test_a_cause_makes_those_needless_alone_that_say_no_more_than_it(viscous, left):
    shape = {"stribeck_rad_s": 15.0, "transition_rad_s": 2.0}

    def friction(_time, _angle, speed):
        fall = np.exp(-((speed / shape["stribeck_rad_s"]) ** 2))
        return 0.3 * fall * np.tanh(speed / shape["transition_rad_s"]) + viscous * speed

    fit = fitted(swinging(8000, friction, mean=0.0))
    costly(fit, term("coulomb-friction", transition_rad_s=2.0), term("viscous-friction"))
    new = joined(fit, (term("stribeck-friction", **shape),))

    def names(fit):
        return tuple(fit.parts[part].name for part in fit.causes())

    # the sweep at the end of a search drops the same ones from the fit that has all three
    state = searching(new.copy())
    assert state.drop_needless()
    assert names(state.fit) == (*left, "stribeck-friction")
    relieve(new)
    assert names(new) == (*left, "stribeck-friction")


def test_a_shape_is_moved_with_its_form_error_and_only_to_a_likelier_fit():
    fit = fitted(swinging(8000, lambda t, a, w: 0.5 * np.tanh(w / 3.0) + 2e-3 * w, mean=0.0))
    fast = term("coulomb-friction", transition_rad_s=9.0)
    _, part = with_terms(fit, term("viscous-friction"), fast)
    attach_forms(fit)
    before, state = value_of(fit), searching(fit)
    state.reshape_all()
    assert value_of(state.fit) > before + 10.0
    assert state.fit.term(part).shape["transition_rad_s"] == pytest.approx(3.0, rel=0.1)
    own = state.fit.form & (state.fit.owner == part)
    # those about the new shape, largest first; the last of them are next to nothing
    now, about = state.fit.rows[own], form_rows(state.fit, part)[0]
    assert len(now) == len(about)
    alike = np.sum(now * about, axis=1) / np.sqrt(np.sum(now**2, axis=1) * np.sum(about**2, axis=1))
    assert np.abs(alike[:8]).min() > 0.99
    again = state.fit
    state.reshape_all()
    assert value_of(state.fit) >= value_of(again)


def test_a_law_has_the_shape_about_which_its_form_error_is_likeliest():
    # no width of the catalogue's law turns over like this, and no slope leads to the best one
    fit = fitted(swinging(8000, lambda t, a, w: 2.0 * w / (np.abs(w) + 5.0), mean=0.0))
    _, part = with_terms(fit, term("coulomb-friction", transition_rad_s=1.0))
    attach_forms(fit)
    by_slopes = stepped(fit, [part])
    best = reshaped(by_slopes, [part])
    assert value_of(best) > value_of(by_slopes) + 100.0
    assert 6.0 < best.term(part).shape["transition_rad_s"] < 10.0


def test_a_law_that_slow_noise_hides_joins_with_its_form_error():
    def friction(_time, _angle, speed):
        return 20.0 * np.tanh(speed) * (1.0 - 0.3 * np.exp(-np.abs(speed) / 8.0))

    fit = fitted(swinging(4000, friction, mean=36.0))
    fit.shapes = fit.shapes.rising()
    fit.settle(6, anew=True)
    attach_forms(fit)
    new = joined(fit, (term("coulomb-friction", transition_rad_s=4.0),))
    # 228 where the form error came after the noise had taken a part of the friction in
    assert value_of(new) > value_of(fit) + 300.0


def test_a_cause_stays_where_the_fit_without_it_is_less_likely(monkeypatch):
    fit = fitted(swinging(8000, lambda t, a, w: 2e-3 * w, mean=0.0))
    costly(fit, term("viscous-friction"), term("warm-up", time_constant_s=3.0))
    # alone, without its form error, none of them seems worth anything
    monkeypatch.setattr(Search, "evidence_of", lambda self, part: -5.0)
    state = searching(fit)
    state.prune(most=0)
    assert [state.fit.parts[part].name for part in state.fit.causes()] == ["viscous-friction"]


@pytest.mark.parametrize(("name", "kept"), [("warm-up", False), ("structural-tone", True)])
def test_a_name_costs_more_in_the_end_than_a_line_that_paid_for_its_place(monkeypatch, name, kept):
    def both(time, angle, speed):
        return 0.02 * np.cos(6.0 * np.pi * time) + 0.1 * (1.0 - np.exp(-time / 3.0))

    fit = fitted(swinging(4000, both, mean=0.0))
    cause = catalogue()[name]
    with_terms(fit, Term(cause, dict.fromkeys((shape.name for shape in cause.shape), 3.0)))
    monkeypatch.setattr(Search, "evidence_of", lambda self, part: 5.0)
    monkeypatch.setattr(Search, "lost_without", lambda self, part: 0.0)
    state = searching(fit)
    state.prune(None, most=0)
    assert bool(state.fit.causes()) is kept


@pytest.mark.parametrize(
    ("saved", "spoils"), [([-1.0] * 16, True), ([-3.0, 3.0, -2.0, 1.0], False), ([1.0] * 16, False)]
)
def test_a_cause_spoils_a_prediction_only_where_the_pieces_agree(saved, spoils):
    counts = np.full(len(saved), 100.0)
    whole = Prediction(np.full(len(saved), 50.0), counts, 1.0)
    without = Prediction(50.0 + np.array(saved), counts, 1.0)
    assert _spoils(whole, without) is spoils


def test_a_play_whose_share_is_a_little_above_one_stays():
    fit = fitted(prepared(reversing(lambda _angle, _speed, load: -np.clip(load, -0.2, 0.2))))
    new = joined(fit, (term("backlash", play_nm=0.2),))
    play = len(fit.parts)
    new.coefficients[new.flat(play)] = 1.05 * new.parts[play].scale
    assert new.linear(play)[0] > new.term(play).cause.linear[0].upper
    assert impossible_parts(new) == set()


def test_a_play_takes_all_that_is_its_own_beside_what_is_not_found_yet():
    def held(_angle, speed, load):
        return -np.clip(load, -0.2, 0.2) - 0.1 * np.tanh(load) + 0.1 * np.tanh(speed)

    fit = fitted(prepared(reversing(held)))
    attach_forms(fit)
    new, (play,) = best_joined(fit, (term("backlash", play_nm=0.1),))
    # beside a further .1 N m of the load's sign its share alone would be half as large again
    assert new.linear(len(fit.parts))[0] == pytest.approx(1.0, abs=0.03)
    assert 0.2 < play.shape["play_nm"] < 0.35
    assert all_possible(new, 1)


def test_a_limit_far_above_the_torque_gains_nothing():
    fit = fitted(swinging(3000))
    new = joined(fit, (term("saturation", limit_nm=400.0, sharpness=4.0),))
    # ripple of .4 N m: of it such a limit takes 1e-12; a fit is settled to .01 nats
    assert abs(value_of(new) - value_of(joined(fit, ()))) < 0.1


# what may be zero is no cause: a form error alone explains the torque then
@pytest.mark.parametrize(("size_nm", "possible"), [(0.3, True), (0.0, False), (-0.3, False)])
def test_a_friction_that_may_be_zero_or_gives_energy_is_not_possible(size_nm, possible):
    fit = fitted(swinging(4000, lambda t, a, w: size_nm * np.tanh(w / 2.0), mean=0.0))
    _, part = with_terms(fit, term("coulomb-friction", transition_rad_s=2.0))
    assert impossible_parts(fit) == (set() if possible else {part})


def test_a_friction_keeps_its_size_beside_a_table_that_can_take_it_in():
    fit = fitted(swinging(4000, lambda t, a, w: 0.005 * w, mean=0.0))
    part = fit.add_term(term("viscous-friction"))
    with_terms(fit, Term(table_of(fit), {}))
    view, places = sized(fit)
    own = places.index(part)
    # 0.05 N m of noise in 4000 samples over a speed of 28 rad/s rms: 2.8e-5 N m s/rad
    assert view.linear(own)[0] == pytest.approx(0.005, abs=1.2e-4)
    assert part not in impossible_parts(fit)


def test_a_part_of_more_than_twice_the_torque_is_no_cause():
    fit, part = with_terms(fitted(swinging(4000)), term("viscous-friction"), rounds=2)
    assert is_within(fit, part)
    own = fit.owner == part
    fit.coefficients[own] *= 3.0 * np.sqrt(np.mean(fit.measured**2)) / fit.size_nm(part)
    assert not is_within(fit, part)


@pytest.mark.parametrize(("other", "ahead"), [("coulomb-friction", 2.0), ("warm-up", 1.0)])
def test_a_pair_goes_ahead_of_lines_only_where_both_follow_the_motion(other, ahead):
    names = ("viscous-friction", other)
    pair = tuple(
        SimpleNamespace(term=SimpleNamespace(cause=catalogue()[name]), plain_nats=10.0)
        for name in names
    )
    assert _turn(pair) == ahead * 20.0


@pytest.mark.parametrize(("axes", "told"), [("time", True), ("velocity", False)])
def test_what_a_table_says_over_the_motion_is_no_random_walk(axes, told):
    n = 20_000
    # .2 N m/s^0.5, 1 kHz
    walk = 0.2 * np.sqrt(1e-3) * np.cumsum(np.random.default_rng(3).standard_normal(n))
    fit = fitted(swinging(n, lambda _t, _a, _w: walk))
    fit.shapes = fit.shapes.rising()
    fit.settle(4, anew=True)
    state, table = searching(fit), table_causes(fit.record)[0]
    table = replace(table, name=f"table:{axes}", columns=lambda motion, shape: walk[:, None])
    state.whole, _ = with_terms(fit.copy(), Term(table, {}), rounds=4)
    found = walk_of(state, float(np.var(walk)))
    assert (found is not None) is told
    if found:
        held = found[0].parameters["intensity_nm_per_sqrt_s"]
        assert held.value == pytest.approx(0.2, abs=4.0 * held.std)


def test_what_went_again_in_another_form_is_not_found_for_ever(monkeypatch):
    state = searching(fitted(swinging(3000)))
    attach_forms(state.fit, idle=True)
    state.fit.settle(5)
    bristles = term("presliding", breakaway_rad=0.1)
    found = refine.candidate_of(state.fit.beside(), state.fit.record, bristles, 1.0, 1.0)
    found = replace(found, gain_nats=20.0, evidence_nats=20.0)
    rounds = []

    def one_round(self):
        rounds.append(1)
        return () if self.dropped.get("presliding", 0) > 1 else (found,)

    def drop_as_another(self, least=1.0, most=1):
        for part in self.fit.causes():
            self.fit.remove(part)
            self.fit.settle(3)
            self.dropped["coulomb-friction"] = 2

    monkeypatch.setattr(Search, "round", one_round)
    monkeypatch.setattr(Search, "prune", drop_as_another)
    state.go_on()
    assert len(rounds) == 2
    assert not state.fit.causes()


@pytest.mark.parametrize(("share", "kept"), [(0.2, 1), (-0.2, 0)])
def test_a_table_that_leaves_more_than_it_found_is_none(monkeypatch, share, kept):
    state = searching(fitted(swinging(3000, lambda _t, _a, w: 0.1 * np.abs(w) ** 0.5, mean=0.0)))
    attach_forms(state.fit, idle=True)
    look = Look(Term(table_of(state.fit), {}), 100.0, 5, 1.0, 1e-9)
    looks = iter([[("table", look)], []])
    monkeypatch.setattr(Search, "_table_looks", lambda self: next(looks))
    monkeypatch.setattr(Search, "explained", lambda self, before: share)
    state.find_tables()
    assert len(state.told.tables()) == kept


@pytest.mark.parametrize(("better", "searches"), [("coulomb-friction", 0), ("hysteresis", 1)])
def test_a_new_name_for_the_same_torque_starts_no_search(monkeypatch, better, searches):
    tables = [
        [
            SimpleNamespace(name=name, evidence_nats=nats, term=term(name))
            for name, nats in (("presliding", 20.0), (better, 30.0))
        ]
    ]
    monkeypatch.setattr(naming, "_table", lambda search, part: tables[0])
    monkeypatch.setattr(naming, "_named", lambda beside, table: table[0].name)
    gone_on = []
    search = SimpleNamespace(
        fit=SimpleNamespace(
            parts=[SimpleNamespace(term=None)],
            causes=lambda: [0],
            beside=lambda part: None,
        ),
        log=[],
        replace_term=lambda part, own, other: tables.insert(0, [other]) is None,
        exchange_for_table=lambda: False,
        reshape_all=lambda: None,
        prune=lambda most: None,
        go_on=lambda: gone_on.append(1),
    )
    assert naming.name_causes(search) == {0: better}
    assert len(gone_on) == searches


def test_a_limit_cannot_lie_far_below_the_torque_that_it_limits():
    limit = term("saturation", limit_nm=0.1, sharpness=1.0)
    fit, part = with_terms(fitted(swinging(3000)), limit)
    renew(fit)
    # ripple of .4 and .2 N m; less than half of the largest torque would leave a square wave
    assert fit.term(part).shape["limit_nm"] == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize(("said_nats", "taken"), [(1e4, False), (-1e4, True)])
def test_a_name_takes_a_place_only_where_the_whole_fit_says_so(said_nats, taken):
    fit = fitted(swinging(3000, lambda _t, _a, w: 0.01 * (w - 50.0)))
    before, part = with_terms(fit, term("viscous-friction"))
    state, left = searching(before), before.without_view(part).beside()
    better = refine.candidate_of(left, before.record, term("zero-drift"), 1, 1)
    better = replace(better, gain_nats=5.0, evidence_nats=5.0)
    own = replace(better, evidence_nats=5.0 + said_nats)
    assert state.replace_term(part, own, better) is taken
    assert (state.fit is before) is not taken


@pytest.mark.parametrize(("true", "left"), [("coulomb-friction", 0), ("presliding", 1)])
def test_the_latest_cause_has_the_likeliest_form_of_its_torque(true, left):
    forms = (
        term("coulomb-friction", transition_rad_s=2.0),
        term("presliding", breakaway_rad=3.0),
    )
    torque = term_columns(next(t for t in forms if t.name == true), swinging(4000, mean=0.0))[:, 0]
    fit = fitted(swinging(4000, lambda _t, _a, _w: 0.3 * torque, mean=0.0))
    with_terms(fit, forms[1])
    attach_forms(fit)
    looks = [SimpleNamespace(term=term, trials=10.0) for term in forms]
    state = searching(fit)
    state.latest, state.names = ("presliding",), SimpleNamespace(looks=lambda beside: looks)
    state.take_best_forms()
    assert [state.fit.term(part).name for part in state.fit.causes()] == [forms[left].name]


@pytest.mark.parametrize("late", [0, 1])
def test_a_delay_that_predicts_nothing_is_taken_out(late):
    # the ripple of a speed of up to 90 rad/s turns by .18 rad in 1 ms
    record = swinging(6000)
    record = replace(record, torque_nm=np.roll(record.torque_nm, late)).behind(None)
    state = searching(fitted(record).retimed(1e-3, 3))
    predicting_delay(state)
    assert state.fit.record.late_s == (1e-3 if late else 0.0)


def test_slow_noise_does_not_push_out_causes_that_say_more(monkeypatch):
    def friction_and_walk(time, _angle, speed):
        walk = np.cumsum(np.random.default_rng(4).standard_normal(len(time)))
        return 0.3 * np.tanh(speed / 2.0) + 0.001 * walk

    # steep noise passes for a low-pass
    fit = start_fit(swinging(6000, friction_and_walk, mean=0.0))
    part = costly(fit, term("coulomb-friction", transition_rad_s=2.0))
    monkeypatch.setattr(Search, "_table_nats", lambda self: 0.0)
    state = searching(fit.copy())
    assert state.accept_slow(0.0)

    def without_friction(self, needed, most):
        self.fit.remove(part)
        self.fit.settle(3)

    # the friction seems needless in the slow noise: what says less as a whole is taken back
    monkeypatch.setattr(Search, "prune", without_friction)
    state = searching(fit.copy())
    assert not state.accept_slow(0.0)
    assert [state.fit.parts[at].name for at in state.fit.causes()] == ["coulomb-friction"]


def test_of_places_that_overlap_on_the_same_axes_the_largest_is_told():
    def place(size_nm, extent, axes=("velocity", None), unit="rad/s"):
        return Unexplained(
            domain=axes[0],
            second_domain=axes[1],
            location=0.5 * sum(extent),
            extent=extent,
            unit=unit,
            size_nm=size_nm,
            share_of_variance=0.1,
        )

    small, large = place(0.1, (-20.0, 5.0)), place(0.3, (0.0, 20.0))
    others = [
        place(0.2, (30.0, 40.0)),
        place(0.05, (0.0, 20.0), ("velocity", "torque")),
        place(0.04, (0.0, 20.0), ("torque", None), "N m"),
    ]
    assert distinct([small, *others, large]) == [large, *others]


@pytest.mark.parametrize("records", [1, 2])
def test_a_line_without_a_name_is_told_with_its_amplitude_and_its_width(records):
    def tone(time, _angle, _speed):
        return 0.1 * np.cos(2.0 * np.pi * 13.0 * time + 1.0)

    fits = [fitted(swinging(6000, tone, seed)) for seed in range(records)]
    fit, cause = fits[0], TONE_LINE
    if records > 1:
        # each record has a phase of its own
        fit = stack_fits(fits)
        (cause,) = stacked_causes([TONE_LINE], records, referenced=False).values()
    _, part = with_terms(fit, Term(cause, {"frequency_hz": 13.0}))
    place = place_of(fit, part, 0.5, 1e-9)
    assert (place.domain, place.second_domain, place.unit) == ("frequency", None, "Hz")
    # an amplitude beside white noise scatters by this
    std = NOISE_NM * np.sqrt(2.0 / (6000 * records))
    assert place.size_nm == pytest.approx(0.1, abs=4.0 * std)
    low, high = place.extent
    assert place.location == pytest.approx(0.5 * (low + high))
    assert high - low == pytest.approx(1.0 / fit.record.span_s)


@pytest.mark.parametrize(
    ("name", "shape", "builds_up"),
    [("coulomb", {"transition_rad_s": 2.0}, True), ("viscous", {}, False)],
)
def test_dry_friction_may_build_up_after_a_reversal_and_viscous_friction_may_not(
    name, shape, builds_up
):
    fit = fitted(swinging(8000, lambda t, a, w: 0.3 * np.tanh(w / 2.0) + 0.01 * w, mean=0.0))
    friction = term(f"{name}-friction", **shape)
    _, part = with_terms(fit, friction)
    torque = term_columns(friction, fit.record) @ fit.linear(part)
    # over a tenth of a radian
    followed, way = torque.copy(), np.abs(np.diff(fit.record.motion.angle_rad))
    for k, step in enumerate(way, start=1):
        followed[k] = torque[k] + np.exp(-step / 0.1) * (followed[k - 1] - torque[k])
    rows, lag = form_rows(fit, part)[0], fit.bands.transform((followed - torque)[:, None])[0]
    left = lag - np.linalg.lstsq(rows.T, lag, rcond=1e-9)[0] @ rows
    # the directions say all of it, or nothing
    share = float(np.sum(left**2) / np.sum(lag**2))
    assert share < 0.1 if builds_up else share > 0.9


def test_shapes_that_are_looked_at_twice_make_no_larger_form_error(monkeypatch):
    fit = fitted(swinging(8000, lambda t, a, w: 0.3 * np.tanh(w / 2.0), mean=0.0))
    _, part = with_terms(fit, term("coulomb-friction", transition_rad_s=2.0))
    once = np.sum(form_rows(fit, part)[0] ** 2)
    monkeypatch.setattr(form, "_RATIOS", 2 * form._RATIOS)
    # but for the smallest directions, which are left out
    assert np.sum(form_rows(fit, part)[0] ** 2) == pytest.approx(once, rel=1e-3)


@pytest.mark.parametrize("wide", [True, False])
def test_a_shape_far_from_the_likeliest_one_is_found_over_the_whole_domain_alone(wide):
    fit = fitted(swinging(6000, lambda t, a, w: 0.3 * np.tanh(w / 15.0), mean=0.0))
    attach_forms(fit, idle=True)
    far = term("coulomb-friction", transition_rad_s=0.3)
    _, (near,) = best_joined(fit, (far,), wide=wide)
    assert (near.shape["transition_rad_s"] == pytest.approx(15.0, rel=0.1)) is wide


def test_the_inertia_has_its_form_error_before_any_cause_is_sought():
    fit = fitted(swinging(4000))
    attach_forms(fit)
    assert [part.form_scale for part in fit.parts if part.name == FIXED] == [0.01]


@pytest.mark.parametrize(
    ("breakaway_rad", "nats", "plain"),
    [(0.01, 50.0, True), (0.02, 98.0, False), (0.02, 99.5, True)],
)
def test_a_form_of_which_the_common_one_says_nearly_all_is_not_told_from_it(
    beside, breakaway_rad, nats, plain
):
    (row,) = own_rows(beside, 1)
    own, other = candidate("presliding", row, 100.0), candidate("coulomb-friction", row, nats)
    own.term = term("presliding", breakaway_rad=breakaway_rad)
    other.term = term("coulomb-friction", transition_rad_s=2.0)
    assert _is_plain(other, own) is plain


def test_an_effect_that_acts_nowhere_is_not_loud(beside):
    nothing, rest = np.zeros(beside.bands.size), beside.residual
    assert loudness(beside.bands, nothing, rest, beside.spectrum.power) == 1.0


def test_a_shape_that_a_record_cannot_show_is_tried_nowhere(beside, monkeypatch):
    # a limit of the channel far above all that a model file may hold
    record, limit = swinging(3000), term("saturation", limit_nm=20.0, sharpness=2.0)
    for module in (form, refine):
        monkeypatch.setattr(module, "shape_bounds", lambda *_: dict.fromkeys(limit.shape, ()))
    assert form._typical_shapes(limit.cause, record) == []
    start = refine.candidate_of(beside, record, limit, 1.0, 1.0)
    assert refine.of_right_size(beside, record, start) is start
