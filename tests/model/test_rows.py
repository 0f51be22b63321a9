"""Rows of any weight, noise and priors of any form, and what is critical."""

import numpy as np
import pytest

import gramian as gm

TWO = [[1.0, 0.0], [0.0, 1.0]]


class TestHeavyRows:
    @pytest.mark.parametrize("weight", [1.0, 1e4, 1e8, 1e14, 1e30, 1e100])
    def test_a_constraint_beside_measurements(self, weight):
        rows = [*TWO, [weight, weight]]
        answer = gm.analyze(rows)
        assert answer.rank == 2
        exact = np.sqrt((1 + weight**2) / (1 + 2 * weight**2))
        np.testing.assert_allclose(answer.crlb_std, exact, rtol=1e-12)
        np.testing.assert_allclose(gm.crlb_std(rows), exact, rtol=1e-12)

    def test_powell_and_reid(self):
        """Rows of 1e16 beside rows of 1, against arithmetic with 60 digits."""
        from mpmath import mp, mpf

        rows = [[0, 1e16, 1e16], [1, 1, 2], [1, 2, 0], [1, 0, 5], [1, 4, 3]]
        with mp.workdps(60):
            a = mp.matrix([[mpf(x) for x in row] for row in rows])
            covariance = (a.T * a) ** -1
            exact = [float(mp.sqrt(covariance[i, i])) for i in range(3)]
        np.testing.assert_allclose(gm.crlb_std(rows), exact, rtol=1e-12)
        np.testing.assert_allclose(gm.analyze(rows).crlb_std, exact, rtol=1e-12)

    @pytest.mark.parametrize("weight", [1e4, 1e6, 1e10, 1e14])
    @pytest.mark.parametrize("n", [2, 4, 5, 20, 70])
    def test_in_a_batch_as_alone(self, weight, n):
        """In lanes one row of weight 1e14 beside others cost 1e-2 of the bounds."""
        rng = np.random.default_rng(n)
        rows = rng.standard_normal((19, n + 3, n))
        for k, trial in enumerate(rows[:-1]):
            trial[rng.permutation(n + 3)[: k % n]] *= weight
        wanted = [gm.analyze(trial).crlb_std for trial in rows]
        np.testing.assert_allclose(gm.crlb_std(rows), wanted, rtol=1e-11 * n)
        for given in (rows[1].tolist(), tuple(map(tuple, rows[1])), rows[1][:, ::-1][:, ::-1]):
            np.testing.assert_allclose(gm.crlb_std(given), wanted[1], rtol=1e-11 * n)

    def test_a_tight_prior_of_a_sum(self):
        problem = gm.Problem(np.eye(3), ["a", "b", "c"], combinations={"sum": [1, 1, 1]})
        std = gm.crlb_std(problem.prior({"sum": 1e-14}))
        np.testing.assert_allclose(std, np.sqrt(2 / 3), rtol=1e-12)
        np.testing.assert_allclose(gm.crlb_std(problem.prior({"sum": 0})), std, rtol=1e-12)
        np.testing.assert_allclose(gm.crlb_std(problem.fix("sum")), std, rtol=1e-12)

    def test_a_row_never_costs(self):
        rng = np.random.default_rng(3)
        for _ in range(400):
            n = int(rng.integers(1, 5))
            count = int(rng.integers(1, 7))
            rows = rng.standard_normal((count, n)) * 10.0 ** rng.uniform(-15, 15, (count, 1))
            before, after = gm.analyze(rows[:-1] if count > 1 else rows * 0), gm.analyze(rows)
            assert after.rank >= before.rank
            assert (after.crlb_std <= before.crlb_std * (1 + 1e-6)).all()

    def test_a_true_null_stays(self):
        rng = np.random.default_rng(4)
        for weight in (1.0, 1e5, 1e10, 1e15):
            basis = rng.standard_normal((2, 3))
            rows = rng.standard_normal((6, 2)) @ basis
            rows[0] *= weight
            assert gm.analyze(rows).rank == 2


class TestExactKnowledge:
    def test_the_same_by_every_way(self):
        rows = np.random.default_rng(0).standard_normal((5, 3))
        problem = gm.Problem(rows, ["a", "b", "c"], combinations={"ab": [1, -1, 0]})
        by_prior = gm.analyze(problem, prior={"ab": 0.0})
        by_fix = gm.analyze(problem.fix("ab"))
        known = gm.analyze(problem).knowing("ab")
        heavy = gm.analyze(problem, prior={"ab": 1e-13})
        for other in (by_fix, known, heavy):
            np.testing.assert_allclose(other.crlb_std, by_prior.crlb_std, rtol=1e-9)
        reduced = rows @ np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        np.testing.assert_allclose(by_prior.crlb_std[[0, 2]], gm.crlb_std(reduced), rtol=1e-12)
        covariance = gm.crlb(problem, {"ab": 0.0})
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), by_prior.crlb_std, rtol=1e-12)

    def test_a_unit_quaternion(self):
        """Four numbers, three freedoms: what scales the quaternion cannot be seen."""
        from scipy.spatial.transform import Rotation

        vectors = np.array([[1.0, 0, 0], [0, 1.0, 0]])
        q = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_quat()

        def seen(x):
            return Rotation.from_quat(x).apply(vectors).ravel()

        names = ["qx", "qy", "qz", "qw"]
        free = gm.from_function(seen, q, 0.01, names)
        tied = gm.from_function(seen, q, 0.01, names, tangent=[tuple(names)])
        assert gm.analyze(free).rank == 3
        answer = gm.analyze(tied)
        assert answer.rank == 4
        assert np.isfinite(answer.crlb_std).all()


class TestNoise:
    times = np.linspace(0, 4, 6)

    def rows(self, sigma):
        model = gm.from_function(
            lambda x: x[0] + x[1] * self.times, [1.0, 2.0], sigma, ["level", "slope"]
        )
        return model.rows()

    def test_every_form_of_the_same(self):
        alike = [
            self.rows(0.5),
            self.rows(np.full(6, 0.5)),
            self.rows(0.25 * np.eye(6)),
            self.rows(np.tile(0.25 * np.eye(3), (2, 1, 1))),
        ]
        for rows in alike:
            np.testing.assert_allclose(gm.gram(rows), gm.gram(alike[0]), rtol=1e-9)

    def test_missing(self):
        sigma = np.array([0.5, np.inf, 0.5, 0.5, np.inf, 0.5])
        kept = np.isfinite(sigma)
        np.testing.assert_allclose(self.rows(sigma), self.rows(0.5)[kept], rtol=1e-9)

    def test_differences_of_all_pairs(self):
        """Redundant: of rank 3, and as good as three differences."""
        from itertools import combinations

        anchors = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]])
        pairs = list(combinations(range(4), 2))

        def bound(chosen):
            d = np.zeros((len(chosen), 4))
            for row, (i, j) in zip(d, chosen, strict=True):
                row[[i, j]] = 1, -1
            return gm.crlb_std(
                gm.from_function(
                    lambda p: d @ np.hypot(*(p - anchors).T), [3.0, 2.0], 0.01 * d @ d.T, ["e", "n"]
                )
            )

        np.testing.assert_allclose(bound(pairs), bound(pairs[:3]), rtol=1e-7)

    def test_an_exact_measurement(self):
        model = gm.from_function(
            lambda x: [x[0] + x[1], x[0], x[1]], [1.0, 2.0], [0.0, 1.0, 1.0], ["a", "b"]
        )
        np.testing.assert_allclose(gm.crlb_std(model), np.sqrt(0.5), rtol=1e-9)

    def test_every_form_of_a_prior(self):
        problem = gm.Problem([[1.0, 1.0]], ["a", "b"])
        wanted = gm.crlb_std(problem, {"a": 2.0})
        for prior in ({"a": (7.0, 2.0)}, {"a": 2.0, "b": np.inf}, [2.0, np.inf]):
            np.testing.assert_allclose(gm.crlb_std(problem, prior), wanted)
            np.testing.assert_allclose(gm.analyze(problem, prior=prior).crlb_std, wanted)
        np.testing.assert_allclose(gm.crlb_std([[1.0, 1.0]], [2.0, np.inf]), wanted)
        full = [[4.0, 1.0], [1.0, 9.0]]
        information = np.ones((2, 2)) + np.linalg.inv(full)
        wanted = np.sqrt(np.diag(np.linalg.inv(information)))
        np.testing.assert_allclose(gm.crlb_std(problem, full), wanted)
        np.testing.assert_allclose(gm.crlb_std([[1.0, 1.0]], full), wanted)
        np.testing.assert_allclose(gm.analyze(problem, prior=full).crlb_std, wanted)


class TestNoisyRows:
    def test_a_corridor(self):
        """Normals of two walls, each entry 1 % off: nothing tells along the corridor."""
        rng = np.random.default_rng(5)
        sigma = 0.01
        for _ in range(20):
            rows = np.zeros((400, 2))
            rows[:, 1] = rng.choice([-1.0, 1.0], 400)
            noisy = rows + sigma * rng.standard_normal(rows.shape)
            plain = gm.analyze(noisy, names=["along", "across"])
            assert plain.status == "observable"
            problem = gm.Problem(noisy, ["along", "across"], row_sigma=sigma)
            answer = gm.analyze(problem)
            assert answer.status == "unobservable"
            assert np.isinf(answer.crlb_std[0])
            assert answer.crlb_std[1] == pytest.approx(1 / 20, rel=0.02)

    def test_bounds_are_corrected(self):
        rng = np.random.default_rng(6)
        rows = rng.standard_normal((2000, 3)) * [1.0, 0.2, 1.0]
        noisy = rows + 0.1 * rng.standard_normal(rows.shape)
        problem = gm.Problem(noisy, ["a", "b", "c"], row_sigma=0.1)
        np.testing.assert_allclose(gm.crlb_std(problem), gm.crlb_std(rows), rtol=0.05)


class TestUndecided:
    names = ("a", "b")

    def test_three_answers(self):
        rows = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-4], [1.0, 1.0 - 1e-4]])

        def status(error):
            return gm.analyze(gm.Problem(rows, self.names, row_error=np.full((3, 2), error))).status

        assert status(1e-7) == "observable"
        assert status(1e-2) == "undecided"

    def test_where_scale_says_weak_anyway(self):
        rows = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
        error = np.full((3, 2), 1e-3)
        problem = gm.Problem(rows, self.names, row_error=error)
        assert gm.analyze(problem).status == "undecided"
        assert gm.analyze(problem, scale=[1.0, 1.0]).status == "unobservable"

    def test_the_reason_gives_numbers_and_advice(self):
        rows = [[1.0, 1.0], [1.0, 1.001]]
        answer = gm.analyze(gm.Problem(rows, self.names, row_error=np.full((2, 2), 0.01)))
        assert "sigma_2" in answer.reason
        assert "give a Jacobian" in answer.reason


class TestWhatNext:
    rows = np.array([[1.0, 0, 0], [1.0, 0.1, 0], [0, 0, 1.0], [0, 0, 1.0]])

    def test_critical_rows(self):
        answer = gm.analyze(self.rows, names=["a", "b", "c"])
        found = {one.name: one for one in answer.critical()}
        assert set(found) == {"row 0", "row 1"}
        # A factor whose square overflows: what becomes unobservable is left.
        worst = answer.critical(factor=1e308)
        assert [one.name for one in worst] == [n for n, one in found.items() if one.nullity]
        assert found["row 0"].nullity == 1
        for i, one in ((i, found.get(f"row {i}")) for i in range(4)):
            left = gm.analyze(np.delete(self.rows, i, axis=0))
            assert (left.rank < 3) == (one is not None)

    def test_growth_as_by_analysis_of_the_rest(self):
        rows = np.random.default_rng(0).standard_normal((7, 4))
        rows[0] *= 5
        answer = gm.analyze(rows)
        for one in answer.critical(1.0):
            rest = gm.crlb_std(np.delete(rows, one.rows, axis=0))
            np.testing.assert_allclose(one.crlb_std, rest, rtol=1e-9)

    def test_groups(self):
        answer = gm.analyze(self.rows, names=["a", "b", "c"])
        (one,) = answer.critical(groups={"first": [2], "both": [2, 3]})
        assert (one.name, one.nullity, one.worst) == ("both", 1, "c")

    def test_candidates(self):
        answer = gm.analyze([[1.0, 1.0, 0.0]], names=["a", "b", "c"])
        offered = [[2.0, 2.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0]]
        ranked = answer.candidates(offered)
        assert [one.gained for one in ranked] == [1, 1, 0]
        # a and b known beats c known.
        assert ranked[0].rows == (2,)
        for one in ranked:
            joined = np.vstack([[1.0, 1.0, 0.0], offered[one.rows[0]]])
            np.testing.assert_allclose(one.crlb_std, gm.crlb_std(joined), rtol=1e-12)
        pair = answer.candidates(offered, groups={"c and a - b": [1, 2]})[0]
        assert pair.gained == 2

    def test_islands(self):
        answer = gm.analyze(self.rows, names=["a", "b", "c"])
        assert answer.islands == (("a", "b"), ("c",))
        assert "not tied to each other: {a, b}, {c}" in answer.summary()


def test_many_states_that_move_together():
    n = 40
    rows = np.diff(np.eye(n), axis=0)
    answer = gm.analyze(rows, names=[f"x{i}" for i in range(n)])
    assert answer.null_combinations == ("all 40 of x move together",)
    assert (answer.null_space != 0).all()


@pytest.mark.parametrize(("count", "n", "rank"), [(90, 70, 70), (90, 70, 60), (50, 70, 50)])
def test_many_states_as_by_numpy(count, n, rank):
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((count, rank)) @ rng.standard_normal((rank, n))
    answer = gm.analyze(rows)
    assert answer.rank == rank
    if rank == n:
        exact = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
        np.testing.assert_allclose(answer.crlb_std, exact, rtol=1e-6)
        np.testing.assert_allclose(gm.crlb_std(rows), answer.crlb_std, rtol=1e-9)
    else:
        assert np.abs(rows @ answer.null_space).max() < 1e-9 * np.abs(rows).max()
        np.testing.assert_array_equal(np.isinf(gm.crlb_std(rows)), np.isinf(answer.crlb_std))


def test_islands_and_critical_measurements_have_their_tables():
    from gramian.report import answer_tables

    rows = [[1.0, 0, 0], [1, 1, 0], [0, 0, 1], [0, 0, 1]]
    tables = {table.title: table for table in answer_tables(gm.analyze(rows, ["a", "b", "c"]))}
    tied = tables["States that no measurement ties to each other"]
    assert [row[1] for row in tied.rows] == ["a, b", "c"]
    vital = tables["Measurements that must not be lost"]
    assert [row[0] for row in vital.rows] == ["row 0", "row 1"]
    assert "not determined" in vital.rows[0][1]
    assert not {"States that no measurement ties to each other"} & {
        table.title for table in answer_tables(gm.analyze(np.eye(2) + 1, ["a", "b"]))
    }
