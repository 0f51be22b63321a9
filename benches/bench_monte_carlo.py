"""Monte Carlo: what the machinery costs beside its kernels, and estimators beside loops."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import exact
import numpy as np
from harness import ALL, OURS, Case, Contest, Contestant, main
from limits import Limit

import gramian as gm
from gramian import _core

TIMES = np.arange(60) * 10.0
PATH = np.stack([np.where(TIMES < 300, 0, 5 * (TIMES - 300)), np.minimum(5 * TIMES, 1500)], axis=1)
STATE = np.array([2000.0, 5000.0, -2.0, 1.0])
SIGMA = float(np.radians(0.1))
SCENE = gm.monte_carlo.Bearings(TIMES, PATH, STATE, SIGMA)


def gram(trials: int, **options: Any) -> gm.monte_carlo.MonteCarloResult:
    """A run of the log determinant of the Gram matrix, simulation included."""
    return gm.monte_carlo.run(
        SCENE, trials, 1, quantities=["gram_logdet"], progress=False, **options
    )


def maximum_likelihood(trials: int, **options: Any) -> gm.monte_carlo.MonteCarloResult:
    """A run of the built-in estimator, simulation included."""
    return gm.monte_carlo.run(SCENE, trials, 1, progress=False, **options)


def overhead_contest(trials: int) -> Contest:
    """The run against one call of the kernel that it is made of."""

    def kernel(_: Any) -> Callable[[], Any]:
        return lambda: _core.bearing_log_det_trials(
            TIMES, SCENE.exact, np.atleast_1d(SIGMA), 1, 0, trials
        )

    few = 3
    wanted = exact.lazily(
        lambda: [
            exact.log_det(exact.gram(exact.bearing_rows(TIMES, z)))
            for z in SCENE.simulate(1, 0, few)
        ]
    )

    def error(found: Any) -> float:
        if isinstance(found, gm.monte_carlo.MonteCarloResult):
            found = found.sample["gram_logdet"]
        return float(np.abs(np.asarray(found)[:few] / wanted() - 1).max())

    return Contest(
        f"Monte Carlo of bearings Gram + log det, {trials} trials, m = 60",
        "trial",
        float(trials),
        None,
        [
            Contestant(OURS, lambda _: lambda: gram(trials)),
            Contestant("gramian, the kernel alone", kernel),
        ],
        limit=Limit(
            {"fma": 60.0 * 12, "sincos": 60.0 * 2, "root": 60.0, "divide": 60.0},
            "for each of 60 bearings a normal number (a logarithm, a root, half a sine and "
            "cosine) and the sums of the Gram matrix",
        ),
        cases={"well": Case(None, error)},
        target="at most 1.2 times the kernel",
    )


def threads_contest(name: str, work: Callable[..., Any], trials: int) -> Contest:
    """The same run on one thread and on two."""
    return Contest(
        f"Monte Carlo of bearings {name}, {trials} trials, by threads",
        "trial",
        float(trials),
        None,
        [
            Contestant(OURS, lambda _: lambda: work(trials, workers=1)),
            Contestant(
                "gramian, all threads", lambda _: lambda: work(trials, workers=ALL), threads=ALL
            ),
        ],
        target="two threads at least 1.8 times one",
    )


def estimator_contest(trials: int, peer_trials: int) -> Contest:
    """Maximum likelihood beside a loop over SciPy, and one over Stone Soup's Jacobians."""

    few = max(2, peer_trials // 20)

    def scipy(*, plain: bool) -> Callable[[Any], Callable[[], Any]]:
        def prepare(bearings: Any) -> Callable[[], Any]:
            from scipy.optimize import least_squares

            return lambda: [scipy_estimate(least_squares, z, plain=plain) for z in bearings]

        return prepare

    def stone_soup(bearings: Any) -> Callable[[], Any]:
        estimate = stone_soup_estimator()
        return lambda: [estimate(z) for z in bearings[:few]]

    def error(found: Any) -> float:
        """Largest distance from the most likely state, in deviations of the bound."""
        best = gm.bearings.localize(TIMES, SCENE.simulate(1, 0, few), PATH, SIGMA).state
        if isinstance(found, gm.monte_carlo.MonteCarloResult):
            errors = [found.sample[f"error_{name}"][:few] for name in SCENE.names]
            found = STATE + np.stack(errors, axis=1)
        return float(np.abs((np.array(found[:few]) - best) / gm.crlb_std(SCENE.problem())).max())

    bearings = SCENE.simulate(1, 0, peer_trials)
    return Contest(
        "bearings maximum likelihood, simulation included, m = 60",
        "trial",
        float(trials),
        bearings,
        [
            Contestant(OURS, lambda _: lambda: maximum_likelihood(trials)),
            Contestant(
                "SciPy least_squares in a loop, its defaults",
                scipy(plain=True),
                part=float(peer_trials),
            ),
            Contestant(
                "SciPy MINPACK with the analytic Jacobian",
                scipy(plain=False),
                part=float(peer_trials),
            ),
            Contestant("Gauss-Newton on Stone Soup's Jacobians", stone_soup, part=float(few)),
        ],
        cases={"well": Case(bearings[:few], error)},
        target="80 000 trials a second; 400 times SciPy, 1000 times Stone Soup",
        note="Error: distance from `gramian.bearings.localize`, whose own error is in its part, in "
        "deviations of the bound.",
    )


def pseudo_linear(bearings: Any) -> Any:
    """The usual start: Li & Sheng 2009, eq. (3), by least squares."""
    s, c = np.sin(bearings), np.cos(bearings)
    rows = np.stack([c, -s, TIMES * c, -TIMES * s], axis=1)
    return np.linalg.lstsq(rows, PATH[:, 0] * c - PATH[:, 1] * s, rcond=None)[0]


def wrapped(angle: Any) -> Any:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def scipy_estimate(least_squares: Callable[..., Any], bearings: Any, *, plain: bool = False) -> Any:
    """Levenberg-Marquardt with the analytic Jacobian; `plain`: trust region, differences."""

    def offsets(state: Any) -> Any:
        return (state[:2] + TIMES[:, None] * state[2:] - PATH).T

    def residual(state: Any) -> Any:
        x, y = offsets(state)
        return wrapped(np.arctan2(x, y) - bearings) / SIGMA

    def jacobian(state: Any) -> Any:
        x, y = offsets(state)
        a, b = y / (x * x + y * y) / SIGMA, -x / (x * x + y * y) / SIGMA
        return np.stack([a, b, TIMES * a, TIMES * b], axis=1)

    start = pseudo_linear(bearings)
    if plain:
        return least_squares(residual, start, x_scale="jac").x
    return least_squares(residual, start, jacobian, method="lm", x_scale="jac").x


def stone_soup_estimator(steps: int = 5) -> Callable[[Any], Any]:
    """Gauss-Newton steps with the measurement model and Jacobian of Stone Soup."""
    from stonesoup.models.measurement.nonlinear import Cartesian2DToBearing
    from stonesoup.types.state import State, StateVector

    # Its name changed with a version.
    differentiate = getattr(Cartesian2DToBearing, "jacobian", None) or Cartesian2DToBearing.jac
    models = [
        Cartesian2DToBearing(
            ndim_state=4,
            mapping=(0, 2),
            noise_covar=np.array([[SIGMA**2]]),
            translation_offset=np.array([[place[0]], [place[1]]]),
        )
        for place in PATH
    ]

    def estimate(bearings: Sequence[float]) -> Any:
        x = pseudo_linear(bearings)
        for _ in range(steps):
            rows, residuals = [], []
            for t, model, bearing in zip(TIMES, models, bearings, strict=True):
                at = State(StateVector([x[0] + t * x[2], x[2], x[1] + t * x[3], x[3]]))
                d = np.asarray(differentiate(model, at), dtype=float)[0]
                rows.append([d[0], d[2], t * d[0], t * d[2]])
                # Its bearings are from the x axis, anticlockwise.
                angle = float(model.function(at, noise=False)[0, 0])
                residuals.append(wrapped(np.pi / 2 - bearing - angle))
            x = x + np.linalg.lstsq(np.array(rows), np.array(residuals), rcond=None)[0]
        return x

    return estimate


R0, V, M = np.array([-10.0, -10.0, 5.0]), np.array([1.0, 1.0, 0.0]), np.array([10.0, 20.0, 10.0])
SECONDS = np.arange(21.0)


def dipole_contest(trials: int, peer_trials: int) -> Contest:
    """Locating a dipole with z0 and vz known, beside a loop over SciPy started at the truth."""
    scene = gm.monte_carlo.Dipole(R0, V, M, SECONDS, 1e-9, known=["z0", "vz"])

    def scipy(_: Any) -> Callable[[], Any]:
        from scipy.optimize import least_squares

        fields = scene.simulate(1, 0, peer_trials)
        # The moment in units in which it is near one, as the positions are.
        unit = np.array([1.0, 1.0, 1.0, 1.0, 10.0, 10.0, 10.0])

        def estimate(field: Any) -> Any:
            def residual(x: Any) -> Any:
                y = x * unit
                r0, v = np.array([y[0], y[1], 5.0]), np.array([y[2], y[3], 0.0])
                r = r0 + SECONDS[:, None] * v
                square = (r * r).sum(axis=1, keepdims=True)
                along = (r @ y[4:])[:, None]
                model = 1e-7 * (3 * along * r - square * y[4:]) / square**2.5
                return ((model - field) / 1e-9).ravel()

            return least_squares(residual, scene.truth / unit, method="lm").x * unit

        return lambda: [estimate(field) for field in fields]

    return Contest(
        "dipole maximum likelihood, simulation included, 21 samples, z0 and vz known",
        "trial",
        float(trials),
        None,
        [
            Contestant(
                OURS, lambda _: lambda: gm.monte_carlo.run(scene, trials, 1, progress=False)
            ),
            Contestant("SciPy least_squares from the truth", scipy, part=float(peer_trials)),
        ],
    )


def registration_contest(trials: int, peer_trials: int, looks: int = 200) -> Contest:
    """Registration biases of two radars, beside a loop over SciPy with sparse Jacobians."""
    path = np.stack([np.linspace(-20e3, 60e3, looks), np.linspace(25e3, 35e3, looks)], axis=1)
    sensors, sigma = np.array([[0.0, 0.0], [60e3, 0.0]]), np.array([50.0, 0.00175])
    biases = np.array([300.0, 0.004, -200.0, -0.007])
    scene = gm.monte_carlo.Registration(path, sensors, sigma, biases)

    def scipy(_: Any) -> Callable[[], Any]:
        from scipy.optimize import least_squares
        from scipy.sparse import lil_matrix

        reports = scene.simulate(1, 0, peer_trials)
        # Each look's four reports depend on its own place and on the biases.
        pattern = lil_matrix((4 * looks, 4 + 2 * looks))
        for k in range(looks):
            pattern[4 * k : 4 * k + 4, 4 + 2 * k : 6 + 2 * k] = 1
            for i in range(4):
                pattern[4 * k + i, i] = 1
        unit = np.concatenate([[100.0, 0.01, 100.0, 0.01], np.full(2 * looks, 1e3)])

        def estimate(report: Any) -> Any:
            def residual(x: Any) -> Any:
                y = x * unit
                offset = y[4:].reshape(looks, 1, 2) - sensors
                exact = np.stack(
                    [
                        np.hypot(*np.moveaxis(offset, -1, 0)),
                        np.arctan2(*np.moveaxis(offset, -1, 0)),
                    ],
                    axis=-1,
                )
                change = exact + y[:4].reshape(2, 2) - report
                change[..., 1] = wrapped(change[..., 1])
                return (change / sigma).ravel()

            start = np.concatenate([np.zeros(4), path.ravel()]) / unit
            found = least_squares(residual, start, jac_sparsity=pattern, method="trf", max_nfev=50)
            return found.x[:4] * unit[:4]

        return lambda: [estimate(report) for report in reports]

    return Contest(
        f"registration maximum likelihood, simulation included, {looks} looks",
        "trial",
        float(trials),
        None,
        [
            Contestant(
                OURS, lambda _: lambda: gm.monte_carlo.run(scene, trials, 1, progress=False)
            ),
            Contestant("SciPy least_squares, sparse", scipy, part=float(peer_trials)),
        ],
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield overhead_contest(200_000 if quick else 1_000_000)
    yield threads_contest("Gram + log det", gram, 200_000 if quick else 1_000_000)
    yield estimator_contest(*((20_000, 40) if quick else (100_000, 200)))
    yield threads_contest("maximum likelihood", maximum_likelihood, 20_000 if quick else 200_000)
    yield dipole_contest(*((200, 10) if quick else (2000, 50)))
    yield registration_contest(*((500, 3) if quick else (5000, 10)))


if __name__ == "__main__":
    main(contests)
