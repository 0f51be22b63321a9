"""Every form of noise and of prior means the same to every function."""

import numpy as np
import pytest

import gramian as gm

NAMES = ("a", "b")
TIMES = np.linspace(0, 3, 4)
X = np.array([1.0, 2.0])
ROWS = np.stack([np.ones(4), TIMES], axis=1)


def line(x):
    return x[0] + x[1] * TIMES


def model(sigma=0.5):
    return gm.from_function(line, X, sigma, NAMES, combinations={"sum": [1.0, 1.0]})


# Each function: the bounds (n,) of a model with a prior.


def by_problem(m, prior):
    return gm.analyze(m.problem().prior(prior)).crlb_std


def by_analyze(m, prior):
    return gm.analyze(m, prior=prior).crlb_std


def by_crlb_std(m, prior):
    return gm.crlb_std(m, prior)


def by_crlb(m, prior):
    return np.sqrt(np.diag(gm.crlb(m, prior)))


def by_estimate(m, prior):
    found = gm.estimate(m, line(X), prior=prior)
    return np.array([found.std[found.names.index(k)] if k in found.names else 0 for k in NAMES])


def by_posterior(m, prior):
    return gm.bounds.posterior([m], np.eye(2), np.zeros((2, 2)), prior).std[-1]


def by_choice(m, prior):
    problem = m.problem().prior(prior)
    nothing = np.zeros((1, 2))
    worth = [gm.choose.select([nothing], 1, name, problem=problem).worth for name in NAMES]
    return np.array(worth)


FUNCTIONS = [by_problem, by_analyze, by_crlb_std, by_crlb, by_estimate, by_posterior, by_choice]

FULL = np.array([[0.04, 0.01], [0.01, 0.09]])

#: Priors, and the information and exact combinations that each is.
PRIORS = {
    "sigma": ({"a": 0.2}, np.diag([25.0, 0.0]), []),
    "mean and sigma": ({"a": (1.0, 0.2)}, np.diag([25.0, 0.0]), []),
    "combination": ({"sum": (3.0, 0.2)}, 25 * np.ones((2, 2)), []),
    "flat": ({"a": 0.2, "b": np.inf}, np.diag([25.0, 0.0]), []),
    "array": ([0.2, np.inf], np.diag([25.0, 0.0]), []),
    "exact": ({"a": 0.0}, np.zeros((2, 2)), [[1.0, 0.0]]),
    "exact combination": ({"sum": 0.0}, np.zeros((2, 2)), [[1.0, 1.0]]),
    "covariance": (FULL, np.linalg.inv(FULL), []),
    "mean and covariance": ((X, FULL), np.linalg.inv(FULL), []),
    "singular covariance": (
        0.04 * np.ones((2, 2)),
        np.ones((2, 2)) / 4 / 0.04,
        [[1.0, -1.0]],
    ),
    "none": (None, np.zeros((2, 2)), []),
}


def bounds_of(information, exact):
    """By the null-space method, with plain matrices."""
    basis = np.eye(2)
    if exact:
        basis = np.linalg.svd(np.array(exact))[2][len(exact) :].T
    covariance = basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T
    return np.sqrt(np.abs(np.diag(covariance)))


def exactness(function):
    """Return how exact exact knowledge is: estimates and choices take it as a heavy row."""
    return {by_estimate: 1e-5, by_choice: 1e-4}.get(function, 1e-12)


@pytest.mark.parametrize("form", PRIORS)
@pytest.mark.parametrize("function", FUNCTIONS)
def test_priors(function, form):
    prior, information, exact = PRIORS[form]
    wanted = bounds_of(ROWS.T @ ROWS / 0.25 + information, exact)
    found = function(model(), {} if prior is None and function is by_problem else prior)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=exactness(function) * wanted.max())


DENSE = 0.25 * (np.eye(4) + 0.4)
BLOCKS = np.tile(0.25 * np.array([[1.0, 0.3], [0.3, 1.0]]), (2, 1, 1))
D = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0]])

NOISES = {
    "one": (0.5, np.eye(4) / 0.25),
    "per row": ([0.5, 1.0, 0.2, 0.3], np.diag([4.0, 1.0, 25.0, 100 / 9])),
    "full": (DENSE, np.linalg.inv(DENSE)),
    "blocks": (BLOCKS, np.kron(np.eye(2), np.linalg.inv(BLOCKS[0]))),
    "missing": ([0.5, np.inf, 0.2, 0.3], np.diag([4.0, 0.0, 25.0, 100 / 9])),
}


@pytest.mark.parametrize("form", NOISES)
@pytest.mark.parametrize("function", FUNCTIONS)
def test_noises(function, form):
    sigma, weight = NOISES[form]
    wanted = bounds_of(ROWS.T @ weight @ ROWS + np.diag([25.0, 0.0]), [])
    np.testing.assert_allclose(function(model(sigma), {"a": (1.0, 0.2)}), wanted, rtol=1e-7)


@pytest.mark.parametrize("function", FUNCTIONS)
def test_exact_measurements(function):
    wanted = bounds_of(ROWS[1:].T @ ROWS[1:] / 0.25 + np.diag([0.0, 4.0]), [ROWS[0]])
    found = function(model([0.0, 0.5, 0.5, 0.5]), {"b": 0.5})
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=exactness(function) * wanted.max())


@pytest.mark.parametrize("function", FUNCTIONS)
def test_hermitian_noise(function):
    covariance = 0.25 * (np.eye(4) + 0.2j * np.tri(4, k=-1) - 0.2j * np.tri(4, k=-1).T)
    m = gm.from_function(
        lambda x: line(x) * np.exp(0.3j), X, covariance, NAMES, combinations={"sum": [1.0, 1.0]}
    )
    jacobian = ROWS * np.exp(0.3j)
    information = 2 * (jacobian.conj().T @ np.linalg.solve(covariance, jacobian)).real
    wanted = bounds_of(information + np.diag([25.0, 0.0]), [])
    if function is by_estimate:
        z = line(X) * np.exp(0.3j)
        found = gm.estimate(m, z, prior={"a": (1.0, 0.2)}).std
    else:
        found = function(m, {"a": (1.0, 0.2)})
    np.testing.assert_allclose(found, wanted, rtol=1e-7)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ({"a": -1.0}, "prior of a = -1.0: must be >= 0"),
        ({"a": (1.0, -1.0)}, "prior of a = -1.0: must be >= 0"),
        ({"c": 1.0}, "prior of 'c': no state or combination has that name"),
        ([1.0, 2.0, 3.0], r"prior has shape \(3,\): must be \(2,\) or \(2, 2\)"),
        ([-1.0, 2.0], r"prior\[0\] = -1.0: must be >= 0"),
        ([[1.0, 2.0], [0.0, 1.0]], "prior is not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "prior is not positive semidefinite"),
        ({"a": (np.nan, 1.0)}, "prior of a"),
        ({"a": "wide"}, "prior of a"),
        (True, "prior"),
    ],
)
def test_bad_priors_are_named_alike(function, prior, message):
    with pytest.raises(gm.InputError, match=message):
        function(model(), prior)


@pytest.mark.parametrize("correlated", [False, True])
def test_an_infinite_variance_is_no_knowledge(correlated):
    rows = np.random.default_rng(3).standard_normal((6, 3))
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, np.inf]])
    if not correlated:
        covariance[:2, :2] *= np.eye(2)
    names = ["a", "b", "c"]
    model = gm.from_function(lambda x: rows @ x, [1.0, 2.0, 3.0], 1.0, names)
    information = rows.T @ rows
    information[:2, :2] += np.linalg.inv(covariance[:2, :2])
    wanted = np.sqrt(np.diag(np.linalg.inv(information)))
    z = rows @ [1.0, 2.0, 3.0]
    for found in (
        gm.crlb_std(rows, covariance),
        gm.crlb_std(model, (np.zeros(3), covariance)),
        gm.analyze(model, prior=covariance).crlb_std,
        gm.estimate(model, z, prior=([1.0, 2.0, 0.0], covariance)).std,
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-6)
    nothing = np.diag([np.inf] * 3)
    np.testing.assert_allclose(gm.crlb_std(rows, nothing), gm.crlb_std(rows))


@pytest.mark.parametrize(
    ("h", "message"),
    [
        (lambda x: [(x[0], x[1]), x[0]], r"h\(x\) cannot be read"),
        (lambda x: {"a": x[0]}, r"h\(x\) cannot be read .*dict"),
        (lambda x: np.ma.array(x, mask=[False, True]), r"h\(x\)\[1\] is masked"),
        (lambda x: [x[0], None], r"h\(x\) cannot be read"),
        (lambda x: [x[0], np.nan], r"h\(x\)\[1\] = nan"),
        (lambda x: [x[0]] * (1 if x[0] > 1 else 2), "must be as many at each state"),
    ],
)
def test_what_h_must_not_return(h, message):
    with pytest.raises(gm.InputError, match=message):
        gm.from_function(h, [1.0, 2.0], 0.1, ["a", "b"])


@pytest.mark.parametrize("error", [ValueError, ArithmeticError, RuntimeError])
def test_a_solver_that_fails_beside_x_has_no_value_there(error):
    def h(x):
        if x[0] > 1.005:
            raise error("no solution")
        return [x[0] * x[1], x[0] + x[1]]

    model = gm.from_function(h, [1.0, 2.0], 0.1, ["a", "b"])
    np.testing.assert_allclose(model.jacobian(), [[2, 1], [1, 1]], rtol=1e-9)
