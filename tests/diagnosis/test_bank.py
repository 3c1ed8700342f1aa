"""Whitened columns of a bank, chunk by chunk, against the operator on whole columns."""

import numpy as np
import pytest

from hdbench.diagnosis.detect.bank import Bank, Member, bank_gram
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.noise.slownoise import RANDOM_WALK, SlowNoise, slow_kernel
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.model import catalogue

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
