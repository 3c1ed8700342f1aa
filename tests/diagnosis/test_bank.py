"""Whitened columns of a bank, chunk by chunk, against the operator on whole columns."""

import numpy as np
import pytest
from scipy import stats

from hdbench.diagnosis.detect.bank import Bank, Member, bank_gram, build_bank
from hdbench.diagnosis.detect.geometry import geometry
from hdbench.diagnosis.detect.law import draw_law
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.noise.slownoise import RANDOM_WALK, SlowNoise, slow_kernel
from hdbench.diagnosis.noise.whitened import Whitener, make_space
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

# three chunks, the last one short
COUNT = 9000


def two_families(valid):
    rng = np.random.default_rng(11)
    table = np.asfortranarray(rng.standard_normal((COUNT, 13)), dtype=np.float32)
    table[~valid] = 0.0
    first, second = (Term(catalogue()[name], {}) for name in ("gain-error", "kinematic-error"))
    places = [(first, slice(0, 4)), (first, slice(4, 7)), (second, slice(7, 13))]
    return Bank(tuple(Member(term, place, 1.0) for term, place in places), table)


@pytest.mark.parametrize("order", [0, 3, 30, COUNT - 1])
def test_gram_of_each_family_is_that_of_its_whitened_columns(order):
    rng = np.random.default_rng(order)
    valid = np.ones(COUNT, dtype=bool)
    valid[4090:4100] = False
    kernel = np.append(1.0, 0.3 * rng.standard_normal(order))
    if order > 100:
        kernel = slow_kernel(SlowNoise(1e4, RANDOM_WALK, 0.0), COUNT)
    used = valid.copy()
    used[:40] = used[4100:4140] = False
    whitener = Whitener(kernel, 0.7, valid, used)
    bank = two_families(valid)
    gram = bank_gram(bank, whitener)
    white = whitener.apply(bank.table.astype(np.float64))
    assert [len(block) for block in gram.blocks] == [7, 6]
    for block, place in zip(gram.blocks, bank.family_places, strict=True):
        wanted = white[:, place].T @ white[:, place]
        # columns of single precision
        np.testing.assert_allclose(block, wanted, rtol=0, atol=1e-5 * wanted.max())
    np.testing.assert_allclose(gram.sample, white[gram.rows], rtol=0, atol=1e-5 * white.max())


def kinematic_record():
    """A shaft that turns evenly faster, for a minute and a quarter of one turn of the output."""
    time = np.arange(COUNT) * 1e-3
    speed, angle = 60.0 + 10.0 * time, 60.0 * time + 5.0 * time**2
    noise = 0.05 * np.random.default_rng(4).standard_normal(COUNT)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": 0.4 * np.cos(2.0 * angle) + noise,
    }
    profile = load_profile("cim-tr-97-06")
    none = np.zeros(COUNT, dtype=bool)
    model = BenchModel.from_profile(profile.data)
    return prepare_record(Trace(columns), profile.data, model, none)


def test_each_harmonic_is_a_member_beside_all_of_them():
    bank = build_bank(kinematic_record(), [catalogue()["kinematic-error"], catalogue()["creep"]])
    places = [(m.place.start, m.place.stop) for m in bank.members if m.term.cause.shape == ()]
    assert places == [(0, 6), (0, 2), (2, 4), (4, 6)]
    assert [m.whole for m in bank.members[:4]] == [True, False, False, False]
    assert all(m.whole for m in bank.members[4:])


def test_harmonics_alone_pay_for_being_tried():
    record = kinematic_record()
    bank = build_bank(record, [catalogue()["kinematic-error"]])
    whitener = Whitener(np.ones(1), 0.05, record.valid, record.valid)
    space = make_space(whitener, record.base, record.response_nm)
    gram = bank_gram(bank, whitener)
    law = draw_law(bank, gram, geometry(bank, gram, space), space, np.random.default_rng(1))
    # the same by hand: numerators of white noise, least squares, the smallest of four p-values
    base = np.linalg.svd(record.base[record.valid], full_matrices=False)[0]
    columns = bank.table[record.valid].astype(np.float64)
    left = columns - base @ (base.T @ columns)
    draws = np.random.default_rng(2).standard_normal((20_000, 6))
    draws = draws @ np.linalg.cholesky(left.T @ left).T
    smallest = np.ones(len(draws))
    for part in (slice(0, 6), slice(0, 2), slice(2, 4), slice(4, 6)):
        inner = left[:, part].T @ left[:, part]
        value = np.einsum("nk,kl,nl->n", draws[:, part], np.linalg.inv(inner), draws[:, part])
        smallest = np.minimum(smallest, stats.chi2.sf(value, part.stop - part.start))
    trials = 0.05 / np.quantile(smallest, 0.05)
    assert 2.0 < trials < 4.0
    # a level of 5 % in 2000 draws is known to a tenth
    told = float(law.families["kinematic-error"].trials(np.array([1e-3]))[0])
    assert told == pytest.approx(trials, rel=0.3)
