"""Sparse rows: the answers of dense ones, and refusals."""

import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array, csr_matrix, random_array

import gramian as gm
from gramian.large import SparseObservability, SparseProblem


def random_rows(seed, rows, n, density=0.1):
    rng = np.random.default_rng(seed)
    return random_array(
        (rows, n), density=density, rng=rng, data_sampler=lambda size: rng.normal(size=size)
    ).tocsr()


@pytest.mark.parametrize("seed", range(6))
def test_sparse_and_dense_agree(seed):
    rows = random_rows(seed, 70, 40, 0.05)
    dense, sparse = gm.analyze(rows.toarray()), gm.analyze(rows)
    assert isinstance(sparse, SparseObservability)
    assert isinstance(sparse, gm.Observability)
    assert (sparse.status, sparse.rank, sparse.reason) == (dense.status, dense.rank, dense.reason)
    np.testing.assert_allclose(sparse.crlb_std, dense.crlb_std, rtol=1e-9)
    if dense.rank == 40:
        assert sparse.logdet == pytest.approx(dense.logdet)
    both = np.linalg.matrix_rank(np.hstack([sparse.null_space.toarray(), dense.null_space]), 1e-9)
    assert both == dense.nullity
    prior = {"x3": 0.5, "x7": 2.0}
    np.testing.assert_allclose(
        gm.analyze(rows, prior=prior).crlb_std,
        gm.analyze(rows.toarray(), prior=prior).crlb_std,
        rtol=1e-9,
    )


def test_problems_change_as_dense_ones_do():
    rows = random_rows(3, 90, 25, 0.2)
    dense, sparse = gm.Problem(rows.toarray(), [f"x{j}" for j in range(25)]), gm.Problem(rows)
    assert isinstance(sparse, SparseProblem)
    changes = [
        lambda p: p.fix("x1", "x4"),
        lambda p: p.prior({"x2": 0.1}).prior({"x2": 0.1}),
        lambda p: p.marginalize(["x0", "x5", "x24"]),
        lambda p: p.prior({"x5": 0.1, "x6": 0.3}).marginalize(["x5", "x7"]),
        lambda p: p.prior({"x6": 0.3}) + p.fix("x0"),
    ]
    for change in changes:
        one, other = change(dense), change(sparse)
        assert one.names == other.names
        np.testing.assert_allclose(gm.analyze(other).crlb_std, gm.analyze(one).crlb_std, rtol=1e-9)
    np.testing.assert_allclose(
        gm.analyze(sparse + dense).crlb_std, gm.analyze(dense + dense).crlb_std, rtol=1e-9
    )


def test_a_nuisance_that_takes_everything_leaves_nothing():
    # x0 enters with b alone: with b unknown, nothing is left of it.
    problem = gm.Problem(([1.0, 1.0, 2.0], ([0, 0, 1], [0, 2, 1])), ["x0", "x1", "b"])
    left = problem.marginalize("b")
    answer = gm.analyze(left)
    assert answer.untouched == ("x0",)
    assert answer.crlb_std[1] == pytest.approx(0.5)


def test_what_is_determined_beside_a_gauge():
    rows = csr_array([[1.0, -1, 0, 0], [0, 1, -1, 0], [0, 0, 0, 2]])
    answer = gm.analyze(rows, ["a.h", "b.h", "c.h", "d.h"])
    assert answer.null_combinations == (
        "all h of the 3 blocks that nothing joins with the others (a, b, c) shift alike",
    )
    np.testing.assert_allclose(answer.crlb_std, [np.inf, np.inf, np.inf, 0.5])
    np.testing.assert_allclose(
        answer.differences([("a.h", "c.h"), ("a.h", "d.h")]), [2**0.5, np.inf]
    )
    covariance = answer.covariance(["a", "d"])
    assert covariance[1, 1] == pytest.approx(0.25)
    assert np.isinf(covariance[0, 0])
    assert np.isnan(covariance[0, 1])
    assert answer.suggestions[0].repairs
    known = answer.knowing("b")
    assert (known.rank, known.repairs) == (4, True)
    np.testing.assert_allclose(known.crlb_std, [1, 0, 1, 0.5])
    measured = answer.knowing({"a.h": 1.0, "b.h": 1.0}, sigma=2.0)
    assert measured.repairs
    assert "a, b, c" in answer.summary()
    assert answer.to_dict()["nullity"] == 1


def test_structure_explains_before_numbers_do():
    # Three states in two rows, and one in none.
    answer = gm.analyze(csr_array([[1.0, 2, 3, 0, 0], [1, 1, 1, 0, 0], [0, 0, 0, 1, 0]]))
    assert answer.untouched == ("x4",)
    ((states, rows),) = answer.shortages
    assert states == ("x0", "x1", "x2")
    assert rows.tolist() == [0, 1]
    assert answer.components == 3
    assert "x4: no measurement touches it" in answer.null_combinations


@pytest.mark.parametrize("kind", [csr_matrix, csr_array, coo_array])
def test_any_form_is_read_and_left_as_it_was(kind):
    # Unsorted, duplicate and explicitly zero entries, and an empty row.
    data, column, start = [2.0, 1.0, 3.0, 0.0, 4.0], [1, 0, 1, 2, 1], [0, 3, 4, 4, 5]
    rows = csr_array((data, column, start), shape=(4, 3))
    given = kind(rows)
    answer = gm.analyze(given)
    dense = gm.analyze([[1.0, 5, 0], [0, 0, 0], [0, 0, 0], [0, 4, 0]])
    assert answer.rank == dense.rank == 2
    np.testing.assert_allclose(answer.crlb_std, dense.crlb_std)
    assert answer.untouched == ("x2",)
    assert rows.indices.tolist() == column
    assert rows.data.tolist() == data


def test_names_by_function_and_blocks():
    problem = gm.Problem(
        csr_array(np.eye(4)), lambda j: f"n{j}", blocks=["a", "a", "b", "b"], units=["m"] * 4
    )
    assert problem.blocks == ("a", "b")
    assert problem.fix("a").names == ("n2", "n3")
    assert gm.analyze(problem.prior({"b": 0.1})).problem.priors == {"n2": 0.1, "n3": 0.1}


EYE = csr_array(np.eye(3))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gm.Problem(csr_array([[1.0, np.nan]]), ["a", "b"]), r"rows\[0, 1\] = nan \(state b\)"),
        (lambda: gm.Problem(EYE, ["a", "b"]), r"shape \(3, 3\): must be \(measurements, 2\)"),
        (lambda: gm.Problem(EYE, ["a", "b", "a"]), "'a' twice"),
        (lambda: gm.Problem(EYE * 1j), "must be real"),
        (lambda: gm.Problem(([1.0], ([0], [3])), ["a", "b"]), r"column\[0\] = 3: must be below 2"),
        (lambda: gm.Problem(([1.0], ([0], [-1])), ["a", "b"]), r"column\[0\] = -1"),
        (lambda: gm.Problem(([1.0], ([2**63], [0])), ["a"]), r"row\[0\] = 9223372036854775808: must be from 0 to 2\^63 - 1"),

        (lambda: gm.Problem(([1.0], ([0.5], [0])), ["a"]), "whole numbers"),
        (lambda: gm.Problem(EYE, ["a", "b", "c"], blocks=["a"]), "blocks has 1"),
        (lambda: gm.Problem(EYE, gauges={"scale": [1.0]}), r"gauges\['scale'\] has shape"),
        (lambda: gm.Problem(EYE).fix("y"), "no state or block is named 'y'"),
        (lambda: gm.Problem(EYE).fix("x0", "x1", "x2"), "every state"),
        (lambda: gm.Problem(EYE).prior({"x0": 0.0}), "prior of x0 = 0"),
        (lambda: gm.analyze(EYE).std_of([1.0, 2.0]), r"shape \(2,\): must be \(3,\)"),
        (lambda: gm.analyze(csr_array((3, 0))), "at least one column"),
        (lambda: gm.analyze(EYE * 1e-160), r"rows have 1e-160 at state x0: its square leaves"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(make, said):
    with pytest.raises(gm.InputError, match=said):
        make()


def test_broken_indices_are_refused():
    rows = csr_array(np.eye(3))
    rows.indices = np.array([0, 1, 7], dtype=np.int32)
    with pytest.raises(gm.InputError, match="no valid matrix in compressed rows"):
        gm.Problem(rows)


@pytest.mark.parametrize("kind", ["coo", "csc", "bsr"])
def test_broken_indices_of_other_forms_are_refused_before_scipy_follows_them(kind):
    rows = csr_array(np.eye(3)).asformat(kind)
    if kind == "coo":
        rows.coords = (np.array([0, 1, 2]), np.array([0, 1, 10**9]))
    else:
        rows.indices = np.array([0, 1, 10**9], dtype=np.int32)
    with pytest.raises(gm.InputError, match=f"no valid matrix in {kind.upper()}"):
        gm.Problem(rows)


def test_rows_that_are_short_are_counted_in_words():
    text = gm.analyze(csr_array([[1.0, 1, 0, 0], [0, 0, 1, 1]]), ["a", "b", "c", "d"]).summary()
    assert "1 row alone touches a and b" in text


def test_memory_is_estimated_before_it_is_taken(monkeypatch):
    from gramian.large import _analysis

    monkeypatch.setattr(_analysis, "available_bytes", lambda: 1_000_000)
    with pytest.raises(MemoryError, match=r"take [\d.]+ GB at its peak: 0\.001 GB are available"):
        gm.analyze(random_rows(1, 900, 400, 0.2))


@pytest.mark.parametrize(
    "make",
    [
        lambda: gm.Problem(([1.0], ([2**62], [0])), ["a"]),
        lambda: gm.Problem(([1.0], ([0], [2**62]))),
        lambda: gm.Problem(csr_array(([1.0], [2**40], [0, 1]), shape=(1, 2**40 + 1))),
    ],
    ids=["row", "column", "columns of a matrix"],
)
def test_a_number_far_out_says_how_much_it_would_take(make):
    with pytest.raises(MemoryError, match=r"would take .* GB: .* GB are available; number the"):
        make()


def test_memory_is_what_the_limits_of_container_and_process_leave(tmp_path, monkeypatch):
    from gramian.large import _problem

    free = _problem.available_bytes()
    assert 0 < free < 2**62
    most, used = tmp_path / "most", tmp_path / "used"
    most.write_text("max\n")
    used.write_text("5000\n")
    monkeypatch.setattr(_problem, "_CONTROL_GROUPS", ((str(most), str(used)),))
    assert _problem.available_bytes() > 6000
    most.write_text("11000\n")
    assert _problem.available_bytes() == 6000
    most.write_text("4000\n")
    assert _problem.available_bytes() == 0


def test_an_empty_problem_is_all_null_space():
    answer = gm.analyze(csr_array((0, 3)))
    assert (answer.rank, answer.nullity, answer.status) == (0, 3, "unobservable")
    assert answer.untouched == ("x0", "x1", "x2")


def test_nothing_depends_on_the_units():
    rows = random_rows(8, 80, 30, 0.1)
    scale = 10.0 ** np.random.default_rng(1).uniform(-6, 6, 30)
    one, other = gm.analyze(rows), gm.analyze(csr_array(rows.multiply(scale)))
    assert one.rank == other.rank
    np.testing.assert_allclose(one.crlb_std / scale, other.crlb_std, rtol=1e-9)
    assert one.gap == pytest.approx(other.gap, rel=1e-3)


def test_a_pickled_answer_makes_its_factor_anew():
    import pickle

    answer = gm.analyze(csr_array([[1.0, -1, 0], [0, 1, -1]]))
    again = pickle.loads(pickle.dumps(answer))
    assert again == answer
    np.testing.assert_array_equal(
        again.differences([("x0", "x2")]), answer.differences([("x0", "x2")])
    )


def test_a_build_without_sparse_problems_says_so(monkeypatch):
    from gramian import _core

    monkeypatch.delattr(_core, "SparseAnalysis")
    with pytest.raises(gm.GramianError, match=r"cannot take sparse problems.*pip install"):
        gm.Problem(csr_array(np.eye(3)), ["a", "b", "c"])
