"""Failures that were planted are found and named, and no others."""

import numpy as np
import pytest

import gramian as gm
from large.planted import KINDS


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_what_was_planted_is_what_is_named(kind):
    for seed in range(25):
        planted = kind(np.random.default_rng([seed, KINDS.index(kind)]))
        answer = gm.analyze(planted.problem)
        found = {(m.kind, m.gauge, frozenset(m.blocks)) for m in answer.missing}
        assert found == planted.wanted, f"seed {seed}: {answer.summary()}"
        assert answer.status == "unobservable"
        assert (
            answer.nullity
            == len(answer.missing)
            == np.linalg.matrix_rank(answer.null_space.toarray())
        )
        # The basis is of the null space, and the dense answer has the same rank.
        rows = planted.problem.all_rows.toarray()
        z = answer.null_space.toarray()
        assert np.abs(rows @ z).max() < 1e-9 * np.linalg.norm(rows) * np.abs(z).max()
        assert answer.rank == gm.analyze(rows, planted.problem.names).rank
