"""Degrees of observability against 50-digit references and published tables."""

import json
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "sins.json").read_text())
EIGENVALUES = np.array([float(x) for x in REFERENCE["eig"]])
SINS = gm.inertial.static_base(np.radians(28.15))
# As the paper: position errors in radians, outputs not weighted.
A, C = SINS.A, SINS.C

# Simple eigenvalues; the eighth and ninth are a pair.
SIMPLE = ["s4", "s5", "s6", "s7", "s10", "s11", "s12", "s13", "s14", "s15"]


def test_model_is_that_of_the_reference():
    reference = np.array([[float(x) for x in row] for row in REFERENCE["A"]])
    assert np.abs(A - reference).max() < 1e-14
    assert np.allclose(A, reference, rtol=1e-13, atol=0)


def test_eigenvalues_to_nine_digits():
    found = gm.linear.degree(A, C, "eigenvalue")
    assert np.abs(found.values[3:] / EIGENVALUES[3:] - 1).max() < 1e-9
    assert found.values[:3].max() < 1e-12 * found.values[-1]
    singular = gm.linear.degree(A, C, "singular_value")
    expected = np.array([float(x) for x in REFERENCE["sv"]])
    assert np.allclose(singular.values[3:], expected[3:], rtol=1e-12, atol=0)


@pytest.mark.parametrize("name", SIMPLE)
def test_eigenvectors_to_eight_digits(name):
    found = gm.linear.degree(A, C, "eigenvalue").vectors[:, int(name[1:]) - 1]
    expected = np.array([float(x) for x in REFERENCE["vec"][name]])
    found = found * np.sign(found @ expected)
    assert np.abs(found - expected).max() < 1e-8


def test_the_pair_of_equal_eigenvalues_spans_height_and_longitude():
    pair = gm.linear.degree(A, C, "eigenvalue").vectors[:, 7:9]
    expected = np.zeros((15, 2))
    expected[7, 0] = expected[8, 1] = 1
    assert np.allclose(pair @ pair.T, expected @ expected.T, atol=1e-8)


def test_orders_of_the_eigenvectors():
    found = gm.linear.degree(A, C, "order", tolerance=0.1)
    assert found.order == (None, None, None, 3, 0, 0, 0, 0, 0, 0, 1, 2, 2, 1, 1)
    for tolerance in (0.00992, 0.999):
        other = gm.linear.degree(A, C, "order", tolerance=tolerance)
        assert other.order[4:] == found.order[4:]
    # To the letter, a part of nearly every combination shows in the last derivative.
    assert sum(order == 14 for order in found.published_order) >= 7
    # By the paper's own formula with a threshold, not the printed 0 and 1.
    strict = gm.linear.degree(A, C, "order", threshold=0.1)
    assert strict.published_order[9:11] == (1, 2)


@pytest.mark.parametrize(
    ("window", "printed"),
    [
        (60.0, "0.326 1.0 0.999 0.999 1.0 0.946 0.0738"),
        (3600.0, "0.324 0.933 0.0664 0.365 0.125 0.936 3.45e-5"),
    ],
)
def test_posterior_over_prior_of_the_inertial_example(window, printed):
    found = gm.linear.degree(SINS, window=window, dt=1.0)
    shown = ["phi_N", "phi_U", "eps_N", "eps_W", "eps_U", "Delta_N", "Delta_U"]
    for name, text in zip(shown, printed.split(), strict=True):
        digits = len(text.split("e")[0].replace(".", "").lstrip("0"))
        value = found.ratio[found.names.index(name)]
        unit = 10.0 ** (np.floor(np.log10(float(text))) - digits + 1)
        assert abs(value - float(text)) <= 0.5000001 * unit, (name, value)


def test_information_is_the_same_in_all_units():
    one = gm.linear.information(SINS, window=600.0, dt=1.0)
    rng = np.random.default_rng(3)
    for _ in range(5):
        d, s = 10.0 ** rng.uniform(-9, 9, 15), 10.0 ** rng.uniform(-9, 9, 6)
        time = 10.0 ** rng.uniform(-6, 6)
        other = gm.linear.information(
            A * d / d[:, None] * time,
            C * d * s[:, None],
            window=600.0 / time,
            dt=1.0 / time,
            R=(SINS.noise * s) ** 2,
            prior=SINS.prior / d,
        )
        assert np.allclose(other.ratio, one.ratio, rtol=1e-8)
        assert np.allclose(other.values[4:], one.values[4:], rtol=1e-7)


def test_information_is_what_analyze_bounds():
    found = gm.linear.information(SINS, window=300.0, dt=1.0)
    answer = gm.analyze(gm.linear.problem(SINS, window=300.0, dt=1.0))
    assert np.allclose(answer.crlb_std, found.posterior, rtol=1e-9)


def test_process_noise_zero_is_none_and_more_noise_knows_less():
    none = gm.linear.information(SINS, window=60.0, dt=1.0)
    zero = gm.linear.information(SINS, window=60.0, dt=1.0, Q=np.zeros((15, 15)))
    some = gm.linear.information(
        SINS, window=60.0, dt=1.0, Q=np.diag([0] * 3 + [1e-4] * 3 + [0] * 9)
    )
    assert np.allclose(none.ratio, zero.ratio, rtol=1e-5)
    assert (some.ratio >= none.ratio * (1 - 1e-6)).all()
    assert some.ratio[14] > 1.5 * none.ratio[14]


def test_covariance_as_prior():
    diagonal = gm.linear.information(SINS, window=60.0, dt=1.0, prior=SINS.prior)
    full = gm.linear.information(SINS, window=60.0, dt=1.0, prior=np.diag(SINS.prior**2))
    assert np.allclose(diagonal.ratio, full.ratio, rtol=1e-12)


def test_older_degrees_reorder_with_the_unit_of_time_and_levels_do_not():
    c = [[1.0, 0, 0], [0, 2.0, 0]]
    orders = []
    for time in (1.0, 60.0, 3600.0):
        a = np.array([[0, 0, 0.01], [0, 0, 0], [0, 0, 0]]) * time
        orders.append(gm.linear.degree(a, c, "eigenvalue").states)
        assert list(gm.linear.levels(a, c).states.values()) == [0, 0, 1]
    assert orders == [("x2", "x0", "x1"), ("x2", "x0", "x1"), ("x0", "x1", "x2")]


BAD = [
    (lambda: gm.linear.degree(A, C, "best", window=1.0, dt=1.0), "method = 'best'"),
    (lambda: gm.linear.degree(A, C), "needs window and dt"),
    (lambda: gm.linear.degree(A, C, window=1.0, dt=1.0), "prior is missing for x0"),
    (lambda: gm.linear.degree(SINS, window=-1.0, dt=1.0), "window = -1"),
    (lambda: gm.linear.degree(SINS, window=1.0, dt=2.0), "dt = 2"),
    (lambda: gm.linear.degree(SINS, window=1.0, dt=1.0, R=-1.0), "a variance must be > 0"),
    (lambda: gm.linear.degree(SINS, window=1.0, dt=1.0, prior={"phi": 1.0}), "no state is named"),
    (lambda: gm.linear.degree(SINS, window=1.0, dt=1.0, prior={"phi_N": 0.0}), "prior of phi_N"),
    (
        lambda: gm.linear.degree(SINS, window=1.0, dt=1.0, prior=-np.eye(15)),
        "prior is not positive definite",
    ),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()
