"""Random pairs with an exactly planted unobservable block, and observable ones."""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def exact_rank(rows):
    """Return the rank of a matrix of integers, by fractions."""
    rows = [[Fraction(int(x)) for x in row] for row in rows]
    rank = 0
    for column in range(len(rows[0]) if rows else 0):
        pivot = next((r for r in range(rank, len(rows)) if rows[r][column]), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for r in range(rank + 1, len(rows)):
            factor = rows[r][column] / rows[rank][column]
            if factor:
                rows[r] = [x - factor * y for x, y in zip(rows[r], rows[rank], strict=True)]
        rank += 1
    return rank


PRIME = 2_147_483_629


def rank_modulo(rows):
    """Return the rank of integers modulo a prime: never above the exact one."""
    left = np.array(rows, dtype=np.int64) % PRIME
    rank = 0
    for column in range(left.shape[1]):
        nonzero = np.flatnonzero(left[rank:, column])
        if not nonzero.size:
            continue
        pivot = rank + nonzero[0]
        left[[rank, pivot]] = left[[pivot, rank]]
        inverse = pow(int(left[rank, column]), PRIME - 2, PRIME)
        left[rank] = left[rank] * inverse % PRIME
        below = left[rank + 1 :]
        left[rank + 1 :] = (below - below[:, [column]] * left[rank] % PRIME) % PRIME
        rank += 1
        if rank == len(left):
            break
    return rank


def hidden_dimension(a, c):
    """Return the unobservable dimension of integers, modulo a prime."""
    n = len(a)
    block = c.astype(np.int64) % PRIME
    rows = [block]
    a = a.astype(np.int64) % PRIME
    for _ in range(n - 1):
        # Products of two numbers below 2^31 are summed one by one.
        total = np.zeros_like(block)
        for k in range(n):
            total = (total + block[:, [k]] * a[k] % PRIME) % PRIME
        block = total
        rows.append(block)
    return n - rank_modulo(np.concatenate(rows))


def shown(a, c):
    """Whether an integer pair is observable for sure: full rank modulo a prime."""
    return hidden_dimension(a, c) == 0


def jordan(rng, n, values, longest):
    """Jordan blocks of up to `longest`, with few different eigenvalues."""
    a = np.zeros((n, n), dtype=np.int64)
    i = 0
    while i < n:
        size = min(n - i, int(rng.integers(1, longest + 1)))
        a[i : i + size, i : i + size] = rng.choice(values) * np.eye(size, dtype=np.int64)
        for j in range(i, i + size - 1):
            a[j, j + 1] = rng.choice([-2, -1, 1, 1, 1, 2, 3])
        i += size
    return a


def defective(rng, kind, n):
    """An integer pair with defective eigenvalues or repeated blocks."""
    p = int(rng.integers(1, 4))
    if kind == "coupled":
        half = rng.integers(-3, 4, (n // 2, n // 2))
        a = np.kron(np.eye(2, dtype=np.int64), half)
        a[: n // 2, n // 2 :] = np.diag(rng.integers(-1, 2, n // 2))
    elif kind == "triangular":
        a = np.triu(rng.integers(-3, 4, (n, n)), 1)
        np.fill_diagonal(a, rng.choice(rng.integers(-3, 4, 3), n))
    else:
        a = jordan(rng, n, rng.integers(-3, 4, int(rng.integers(1, 4))), int(rng.integers(1, 8)))
    n = len(a)
    c = rng.integers(-2, 3, (p, n)) * (rng.uniform(size=(p, n)) < rng.choice([0.3, 0.6, 1.0]))
    if kind == "tail":
        seen = int(rng.integers(1, n))
        a[seen:, :seen] = rng.integers(-2, 3, (n - seen, seen))
        a[:seen, seen:] = 0
        c[:, seen:] = 0
    t, inverse = unimodular(rng, n)
    return t @ a @ inverse, c @ inverse


def unimodular(rng, n):
    """An integer matrix of determinant 1 with its inverse, of small entries."""
    p, q = np.eye(n, dtype=np.int64), np.eye(n, dtype=np.int64)
    for _ in range(2 * n):
        if max(np.abs(p).max(), np.abs(q).max()) > 8:
            break
        i, j = rng.choice(n, 2, replace=False)
        sign = int(rng.integers(0, 2)) * 2 - 1
        p[:, j] += sign * p[:, i]
        q[i] -= sign * q[j]
    order = rng.permutation(n)
    return p[:, order], q[order]


def planted(rng, n, hidden, kind="integer", repeated=False, units=0):
    """A and C of which exactly `hidden` combinations are not shown.

    `repeated`: the hidden block has eigenvalues of the shown one, and is coupled to it.
    `units`: powers of two between the units of states.
    """
    seen = n - hidden
    while True:
        p = int(rng.integers(1, 4))
        a, c = rng.integers(-3, 4, (n, n)), rng.integers(-3, 4, (p, n))
        a[:seen, seen:] = 0
        c[:, seen:] = 0
        if repeated:
            k = min(hidden, seen)
            a[seen : seen + k, seen:] = 0
            a[seen : seen + k, seen : seen + k] = a[:k, :k]
        if shown(a[:seen, :seen], c[:, :seen]):
            break
    if kind == "integer":
        t, inverse = unimodular(rng, n)
        a, c = (t @ a @ inverse).astype(float), (c @ inverse).astype(float)
    else:
        t, _ = np.linalg.qr(rng.normal(size=(n, n)))
        a, c = t @ a @ t.T, c @ t.T
    d = 2.0 ** rng.integers(-units, units + 1, n)
    return a * d / d[:, None], c * d
