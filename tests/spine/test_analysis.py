"""What analyze says: invariances, status, knowledge, and the operations of a problem."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm


def random_rows(seed, k=12, n=4):
    return np.random.default_rng(seed).normal(size=(k, n))


@given(seed=st.integers(0, 10_000), exponents=st.lists(st.integers(-9, 9), min_size=4, max_size=4))
@settings(max_examples=50, deadline=None)
def test_rank_and_bounds_do_not_depend_on_units(seed, exponents):
    rows = random_rows(seed)
    rows[:, 3] = rows[:, 0] - 2 * rows[:, 1] if seed % 2 else rows[:, 3]
    unit = 10.0 ** np.array(exponents)
    plain, scaled = gm.analyze(rows), gm.analyze(rows * unit)
    assert plain.rank == scaled.rank == (3 if seed % 2 else 4)
    np.testing.assert_allclose(scaled.crlb_std * unit, plain.crlb_std, rtol=1e-8)
    np.testing.assert_allclose(scaled.singular_values, plain.singular_values, rtol=1e-8, atol=1e-13)


def test_null_space_is_what_the_rows_do_not_see():
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(30, 4)) @ rng.normal(size=(4, 7)) * 10.0 ** rng.integers(-6, 6, size=7)
    answer = gm.analyze(rows)
    assert answer.rank == 4
    assert answer.nullity == 3
    seen = np.abs(rows @ answer.null_space)
    moved = np.abs(rows)[:, :, None] * np.abs(answer.null_space)[None]
    assert (seen < 1e-11 * moved.sum(axis=1)).all()
    # Each column has a leading 1 that the others do not contain.
    leads = [int(np.flatnonzero(np.isclose(column, 1))[0]) for column in answer.null_space.T]
    assert np.array_equal(answer.null_space[leads], np.eye(3))


def test_information_is_additive_and_a_prior_is_a_measurement():
    a, b = random_rows(1), random_rows(2)
    both = np.vstack([a, b])
    np.testing.assert_allclose(gm.gram(both), gm.gram(a) + gm.gram(b), rtol=1e-12)
    names = ["a", "b", "c", "d"]
    joined = gm.Problem(a, names) + gm.Problem(b, names)
    np.testing.assert_allclose(gm.crlb_std(joined), gm.crlb_std(both), rtol=1e-12)
    with_prior = gm.crlb_std(gm.Problem(a, names).prior({"b": 0.2}))
    as_row = gm.crlb_std(np.vstack([a, [[0, 5.0, 0, 0]]]))
    np.testing.assert_allclose(with_prior, as_row, rtol=1e-12)
    np.testing.assert_allclose(
        gm.crlb_std(a, prior=[np.inf, 0.2, np.inf, np.inf]), as_row, rtol=1e-12
    )


def test_joining_problems_of_different_states():
    left = gm.Problem([[1.0, 1.0]], ["x", "bias"], units=["m", "m"])
    right = gm.Problem([[1.0]], ["bias"])
    answer = gm.analyze(left + right)
    assert answer.names == ("x", "bias")
    assert answer.units == ("m", "m")
    np.testing.assert_allclose(answer.crlb_std, [np.sqrt(2), 1])
    with pytest.raises(gm.InputError, match="in m in one problem"):
        left + gm.Problem([[1.0]], ["bias"], units=["deg"])


def test_weighted_gram_against_numpy():
    rows = np.random.default_rng(3).normal(size=(5, 40, 3))
    weights = np.random.default_rng(4).uniform(0, 2, size=(5, 40))
    expected = np.einsum("bki,bk,bkj->bij", rows, weights, rows)
    np.testing.assert_allclose(gm.gram(rows, weights), expected, rtol=1e-13)
    np.testing.assert_allclose(gm.gram(rows), np.einsum("bki,bkj->bij", rows, rows), rtol=1e-13)


@pytest.mark.parametrize("dropped", [["b"], ["a", "d"]])
def test_marginalizing_is_the_schur_complement(dropped):
    rows = random_rows(8)
    names = ["a", "b", "c", "d"]
    problem = gm.Problem(rows, names)
    keep = [i for i, name in enumerate(names) if name not in dropped]
    covariance = np.linalg.inv(rows.T @ rows)[np.ix_(keep, keep)]
    np.testing.assert_allclose(gm.crlb(problem.marginalize(dropped)), covariance, rtol=1e-9)


def test_marginalizing_a_state_that_is_not_determined_takes_only_what_it_must():
    """x and bias are seen only as a sum; y is seen alone."""
    problem = gm.Problem([[1.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 1.0]], ["x", "y", "bias"])
    answer = gm.analyze(problem.marginalize(["bias"]))
    assert answer.null_combinations == ("x +1",)
    np.testing.assert_allclose(answer.crlb_std, [np.inf, 0.5])


def test_a_prior_of_a_marginalized_state_is_used():
    problem = gm.Problem([[1.0, 1.0]], ["x", "bias"]).prior({"bias": 0.5})
    np.testing.assert_allclose(gm.crlb_std(problem.marginalize("bias")), [np.sqrt(1.25)])


def test_fixing_drops_a_column():
    rows = random_rows(9)
    fixed = gm.Problem(rows, ["a", "b", "c", "d"]).fix("c")
    np.testing.assert_allclose(gm.crlb_std(fixed), gm.crlb_std(rows[:, [0, 1, 3]]), rtol=1e-12)


def test_suggestions_are_what_fixing_would_give():
    rows = random_rows(10)
    rows[:, 3] = rows[:, 0] + rows[:, 1]
    problem = gm.Problem(rows, ["a", "b", "c", "d"], combinations={"a - b": [1, -1, 0, 0]})
    answer = gm.analyze(problem)
    assert answer.null_combinations == ("a +1, b +1, d -1",)
    by_name = {s.name: s for s in answer.suggestions}
    assert by_name["c"].nullity == 1
    assert not by_name["c"].repairs
    assert by_name["a - b"].nullity == 1, "the null direction has no part in a - b"
    assert answer.suggestions[-1].name in {"c", "a - b"}
    fixed = gm.crlb_std(rows[:, [1, 2, 3]])
    np.testing.assert_allclose(by_name["a"].crlb_std, [0, *fixed], rtol=1e-9)
    # A tight prior approaches exact knowledge.
    tight = answer.knowing("a", 1e-7)
    np.testing.assert_allclose(tight.crlb_std[1:], fixed, rtol=1e-6)


def test_exact_knowledge_of_a_combination():
    """Knowing a + b of two states that are both seen: against substituting b = const - a."""
    rows = random_rows(11, n=2)
    answer = gm.analyze(gm.Problem(rows, ["a", "b"], combinations={"sum": [1, 1]}))
    std = answer.knowing("sum").crlb_std
    expected = 1 / np.linalg.norm(rows[:, 0] - rows[:, 1])
    np.testing.assert_allclose(std, [expected, expected], rtol=1e-12)
    assert answer.std_of([2.0, 0.0]) == pytest.approx(2 * answer.crlb_std[0])


class TestStatus:
    rows = np.diag([1.0, 0.1])

    def test_observable(self):
        answer = gm.analyze(self.rows)
        assert (answer.status, answer.decided_by) == ("observable", ())

    def test_a_bound_above_the_scale_is_weak(self):
        answer = gm.analyze(self.rows, names=["x", "v"], scale=[2.0, 5.0])
        assert (answer.status, answer.decided_by) == ("weak", ("v",))
        assert "v" in answer.reason
        assert gm.analyze(self.rows, ["x", "v"], {"v": 5.0}, weak_ratio=3.0).status == "observable"

    def test_what_only_the_prior_holds_up_is_weak(self):
        answer = gm.analyze([[1.0, 0.0]], ["x", "v"], prior={"v": 3.0})
        assert answer.rank == 2
        assert (answer.status, answer.decided_by) == ("weak", ("v",))
        np.testing.assert_allclose(answer.crlb_std, [1, 3])
        assert np.isinf(answer.data_std[1])

    def test_ill_conditioned_without_scale_is_weak(self):
        rows = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-9]])
        assert gm.analyze(rows).status == "weak"
        assert gm.analyze(rows, weak_condition=1e12).status == "observable"

    def test_nothing_measured(self):
        answer = gm.analyze(gm.Problem(np.zeros((0, 2)), ["x", "y"]))
        assert (answer.rank, answer.status) == (0, "unobservable")
        assert answer.null_combinations == ("x +1", "y +1")
        assert np.isinf(answer.crlb_std).all()

    def test_a_state_that_nothing_measures(self):
        answer = gm.analyze([[1.0, 0.0], [2.0, 0.0]], ["x", "y"])
        assert answer.null_combinations == ("y +1",)
        assert answer.decided_by == ("y",)


def test_the_answer_goes_through_json():
    answer = gm.analyze([[1.0, 2.0], [2.0, 4.0]], ["x", "v"])
    data = json.loads(json.dumps(answer.to_dict(), allow_nan=False))
    assert data["crlb_std"] == ["inf", "inf"]
    assert data["logdet"] == "-inf"
    assert "UNOBSERVABLE" in answer.summary()
    assert "x +1, v -0.5" in answer.summary()


def test_plot_draws_one_bar_for_each_singular_value():
    figure = gm.analyze([[1.0, 2.0], [2.0, 4.0]], ["x", "v"]).plot()
    assert len(figure.axes[0].patches) == 2


class TestFromFunction:
    times = np.linspace(0, 4, 9)

    def h(self, x):
        return x[0] * np.sin(x[1] * self.times) + x[2]

    def jacobian(self, x):
        t = self.times
        return np.stack([np.sin(x[1] * t), x[0] * t * np.cos(x[1] * t), 1 + 0 * t], axis=1)

    @pytest.mark.parametrize(("method", "tolerance"), [("central", 1e-9), ("complex", 1e-15)])
    def test_derivatives(self, method, tolerance):
        x = np.array([2.0, 0.7, -1.0])
        problem = gm.from_function(self.h, x, 0.1, ["a", "w", "c"], method=method)
        expected = self.jacobian(x) / 0.1
        np.testing.assert_allclose(
            problem.rows(), expected, atol=tolerance * np.abs(expected).max()
        )
        given = gm.from_function(
            self.h, x, 0.1, ["a", "w", "c"], method="given", jacobian=self.jacobian
        )
        np.testing.assert_allclose(given.rows(), expected, rtol=1e-15)

    def test_noise_of_differences_is_not_information(self):
        """a and b act only as a sum, whatever rounding does to the differences."""
        problem = gm.from_function(
            lambda x: np.sin(self.times * (x[0] + x[1])), [0.3, 0.4], 1.0, ["a", "b"]
        )
        assert gm.analyze(problem).rank == 1

    def test_covariance_whitens(self):
        rng = np.random.default_rng(0)
        half = rng.normal(size=(9, 9))
        covariance = half @ half.T + np.eye(9)
        x = np.array([2.0, 0.7, -1.0])
        problem = gm.from_function(self.h, x, covariance, ["a", "w", "c"], method="complex")
        jacobian = self.jacobian(x)
        expected = jacobian.T @ np.linalg.solve(covariance, jacobian)
        np.testing.assert_allclose(gm.gram(problem.rows()), expected, rtol=1e-10)


def test_thread_count_changes_nothing():
    rows = np.random.default_rng(2).normal(size=(3000, 20, 4))
    results = []
    before = gm.set_threads(1)
    try:
        for threads in (1, 2, 8):
            gm.set_threads(threads)
            results.append((gm.gram(rows), gm.crlb_std(rows)))
    finally:
        gm.set_threads(before)
    for other in results[1:]:
        np.testing.assert_array_equal(results[0][0], other[0])
        np.testing.assert_array_equal(results[0][1], other[1])


def test_inputs_of_any_kind():
    rows = np.random.default_rng(2).normal(size=(6, 20, 4))
    expected = gm.gram(rows)
    np.testing.assert_array_equal(gm.gram(rows.tolist()), expected)
    np.testing.assert_array_equal(gm.gram(np.asfortranarray(rows)), expected)
    wide = np.zeros((6, 20, 8))
    wide[..., ::2] = rows
    np.testing.assert_array_equal(gm.gram(wide[..., ::2]), expected)
    single = rows.astype(np.float32)
    np.testing.assert_allclose(gm.gram(single), expected, rtol=1e-4, atol=1e-4)
    assert gm.gram(np.ones((2, 3), dtype=int)).tolist() == [[2, 2, 2]] * 3
