"""What is chosen, and within how much of the best it is."""

from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import csr_array

import gramian as gm


def crowd(seed, count=9, n=3):
    rng = np.random.default_rng(seed)
    return {f"c{k}": rng.normal(size=(2, n)) * rng.uniform(0.3, 2) for k in range(count)}


def worth(rows, goal):
    information = sum(r.T @ r for r in rows)
    if goal == "D":
        return np.linalg.slogdet(information)[1] / 2
    covariance = np.linalg.inv(information)
    return {
        "A": -np.sqrt(np.trace(covariance) / len(covariance)),
        "E": -np.sqrt(np.linalg.eigvalsh(covariance)[-1]),
        "x1": -np.sqrt(covariance[1, 1]),
    }[goal]


@pytest.mark.parametrize("goal", ["D", "A", "E", "x1"])
def test_no_choice_is_better_than_the_limit_says(goal):
    for seed in range(8):
        candidates = crowd(seed)
        choice = gm.choose.select(candidates, 3, goal)
        best = max(worth([candidates[k] for k in c], goal) for c in combinations(candidates, 3))
        own = worth([candidates[k] for k in choice.chosen], goal)
        assert choice.worth == pytest.approx(own if goal == "D" else -own, rel=1e-9)
        if goal == "E":
            assert np.isnan(choice.within)
            continue
        reached = np.exp((own - best) / 3) if goal == "D" else best / own
        assert 1 - reached <= choice.within + 1e-9
        assert choice.within < 0.25
        assert sum(choice.weights.values()) == pytest.approx(3)


def test_rank_first_and_a_guarantee_only_where_there_is_one():
    candidates = {"x": [100.0, 0], "x again": [90.0, 0], "y": [0, 0.1]}
    choice = gm.choose.select(candidates, 2)
    assert set(choice.chosen) == {"x", "y"}
    assert np.isnan(choice.guarantee)
    known = gm.Problem(np.eye(2), ["x0", "x1"])
    choice = gm.choose.select(candidates, 1, problem=known)
    assert choice.chosen == ("x",)
    assert choice.guarantee == pytest.approx(1 - 1 / np.e)
    assert choice.gains[0] == pytest.approx(np.log(10001) / 2)
    short = gm.choose.select({"x": [1.0, 0], "x again": [2.0, 0]}, 2)
    assert short.nullity == 1
    assert "still not observable" in str(short)


def test_a_sparse_problem_is_reduced_to_what_the_candidates_touch():
    n = 40
    chain = csr_array((np.tile([-1.0, 1.0], n - 1), np.add.outer(np.arange(n - 1), [0, 1]).ravel(),
                       np.arange(0, 2 * n, 2)), shape=(n - 1, n))  # fmt: skip
    problem = gm.Problem(chain).fix("x0")
    candidates = {}
    for k in (5, 20, 38):
        row = np.zeros(n - 1)
        row[k] = 1.0
        candidates[f"x{k + 1}"] = csr_array(row[None])
    choice = gm.choose.select(candidates, 1, "x30", problem=problem)
    rows = {key: np.vstack([problem.rows.toarray(), c.toarray()]) for key, c in candidates.items()}
    bounds = {key: gm.crlb_std(r)[29] for key, r in rows.items()}
    assert choice.chosen == (min(bounds, key=bounds.get),)
    assert choice.worth == pytest.approx(min(bounds.values()), rel=1e-8)


@pytest.mark.parametrize("goal", ["D", "A", "x6"])
def test_candidates_that_leave_a_gauge_say_so(goal):
    # Differences of heights: no number of them gives the level.
    n = 50
    ends = np.add.outer(np.arange(n - 1), [0, 1]).ravel()
    chain = csr_array((np.tile([-1.0, 1.0], n - 1), ends, np.arange(0, 2 * n, 2)), shape=(n - 1, n))
    candidates = {
        f"{k} to {k + 3}": csr_array(([1.0, -1.0], ([0, 0], [k, k + 3])), shape=(1, n))
        for k in range(5)
    }
    choice = gm.choose.select(candidates, 2, goal, problem=gm.Problem(chain))
    assert choice.nullity == 1
    assert "1 combination is still not observable" in str(choice)
    # With one height among the candidates it is taken, and its level is all that was missing.
    candidates["height"] = csr_array(([1.0], ([0], [4])), shape=(1, n))
    choice = gm.choose.select(candidates, 2, goal, problem=gm.Problem(chain))
    assert choice.nullity == 0
    assert "height" in choice.chosen


@pytest.mark.parametrize("goal", ["D", "A", "x3", {"x2": 1.0, "x9": 4.0}])
def test_a_sparse_problem_is_chosen_for_as_a_dense_one(goal):
    rng = np.random.default_rng(4)
    n = 12
    rows = rng.normal(size=(30, n)) * (rng.uniform(size=(30, n)) < 0.3) + np.eye(30, n)
    candidates = {f"c{k}": rng.normal(size=(2, n)) for k in range(10)}
    names = [f"x{j}" for j in range(n)]
    dense = gm.choose.select(candidates, 3, goal, problem=gm.Problem(rows, names))
    sparse = gm.choose.select(candidates, 3, goal, problem=gm.Problem(csr_array(rows), names))
    assert sparse.chosen == dense.chosen
    assert sparse.worth == pytest.approx(dense.worth, rel=1e-9)
    assert sparse.within == pytest.approx(dense.within, abs=1e-6)
    assert (sparse.rank, sparse.nullity) == (n, 0)
    assert sum(sparse.weights.values()) == pytest.approx(3)
    np.testing.assert_allclose(sparse.gains, dense.gains, rtol=1e-6)


@pytest.mark.parametrize("goal", ["A", "E", "x1"])
def test_gains_are_what_each_choice_lowered(goal):
    rng = np.random.default_rng(9)
    base = rng.normal(size=(6, 4))
    candidates = {f"c{k}": rng.normal(size=4) for k in range(5)}
    problem = gm.Problem(base, [f"x{j}" for j in range(4)])
    choice = gm.choose.select(candidates, 2, goal, problem=problem, exchange=False)

    def worth(rows):
        covariance = np.linalg.inv(rows.T @ rows)
        if goal == "E":
            return np.sqrt(np.linalg.eigvalsh(covariance)[-1])
        return np.sqrt(np.trace(covariance) / 4 if goal == "A" else covariance[1, 1])

    steps = [np.vstack([base, *(candidates[c] for c in choice.chosen[:k])]) for k in range(3)]
    levels = [worth(rows) for rows in steps]
    np.testing.assert_allclose(choice.gains, -np.diff(levels), rtol=1e-8)


def test_a_problem_of_more_states_than_could_be_dense():
    n = 3000
    chain = csr_array(
        (
            np.tile([-1.0, 1.0], n - 1),
            np.add.outer(np.arange(n - 1), [0, 1]).ravel(),
            np.arange(0, 2 * n, 2),
        ),
        shape=(n - 1, n),
    )
    problem = gm.Problem(chain).fix("x0")
    candidates = {
        f"x{k}": csr_array(([10.0], ([0], [k - 1])), shape=(1, n - 1)) for k in range(9, n, 30)
    }
    choice = gm.choose.select(candidates, 1, "A", problem=problem)
    # One more fixed point of a random walk: the mean variance is least with it at
    # three quarters of the way, as that of k steps is k and of a bridge k (m - k) / m.
    assert abs(int(choice.chosen[0][1:]) - 3 * n / 4) <= 30
    # A fraction of each of many points would tell far more than any one of them whole.
    assert 0 <= choice.within < 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (({}, 1), "candidates is empty"),
        (({"a": [1.0, 0]}, 2), "budget = 2: must be from 1 to 1"),
        (({"a": [1.0, 0]}, 0), "budget = 0"),
        (({"a": [1.0, 0], "b": [1.0]}, 1), "candidate 'b' has shape"),
        (({"a": [1.0, np.nan]}, 1), "candidate 'a'.* = nan"),
        (({"a": [1.0, 0]}, 1, "size"), "goal = 'size'"),
        (({"a": csr_array([[1.0, np.nan]])}, 1), "candidate 'a' has an entry of size nan"),
        (({"a": csr_array([[1j, 0]])}, 1), "candidate 'a' is complex128"),
        (({"a": [1e200, 0]}, 1), "candidate 'a' has an entry of size 1e\\+200"),
        (({"a": [1.0, 0]}, 1, {"y": 1.0}), "goal names 'y'"),
        (({"a": [1.0, 0]}, 1, {"x0": -1.0}), "must be > 0"),
    ],
)
def test_what_cannot_be_chosen_from_is_named(arguments, said):
    with pytest.raises(gm.InputError, match=said):
        gm.choose.select(*arguments)
