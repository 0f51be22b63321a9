"""Monte Carlo: what the machinery costs beside its kernels, and estimators beside loops."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import bench_bearings
import bench_dipole
import bench_localize
import bench_registration
import exact
import numpy as np
from harness import ALL, OURS, Case, Contest, Contestant, main
from limits import Limit

import gramian as gm
from gramian import _core

mc = gm.monte_carlo
TIMES = np.arange(60) * 10.0
PATH = np.stack([np.where(TIMES < 300, 0, 5 * (TIMES - 300)), np.minimum(5 * TIMES, 1500)], axis=1)
STATE = np.array([2000.0, 5000.0, -2.0, 1.0])
TRACK = bench_localize.Track(TIMES, PATH, float(np.radians(0.1)))
FEW = 2  # trials that each contestant is asked for its accuracy


def run(data: Any, **options: Any) -> Any:
    """A run of a scene's estimator, simulation included."""
    scene, trials = data
    return mc.run(scene, trials, 1, progress=False, **options)


def ours(limit: Limit, **options: Any) -> list[Contestant]:
    """A run on one thread and on all."""

    def on(workers: int) -> Callable[[Any], Callable[[], Any]]:
        return lambda data: lambda: run(data, workers=workers, **options)

    return [
        Contestant(OURS, on(1), limit=limit),
        Contestant("gramian, all threads", on(ALL), threads=ALL, limit=limit),
    ]


def bearings_scene(sigma: float, turn: float = 1.0) -> Any:
    """Bearings of a target from a path that turns, or from one that is almost straight."""
    return mc.Bearings(TIMES, PATH * [turn, 1.0], STATE, sigma)


def log_det_contest(trials: int) -> Contest:
    """The run against one call of the kernel that it is made of."""

    def kernel(data: Any) -> Callable[[], Any]:
        scene, trials = data
        sigma = np.atleast_1d(scene.sigma)
        return lambda: _core.bearing_log_det_trials(TIMES, scene.exact, sigma, 1, 0, trials)

    def case(scene: Any) -> Case:
        wanted = exact.lazily(
            lambda: [
                exact.log_det(exact.gram(exact.bearing_rows(TIMES, z)))
                for z in scene.simulate(1, 0, FEW)
            ]
        )

        def error(found: Any) -> float:
            if isinstance(found, mc.MonteCarloResult):
                found = found.sample["gram_logdet"]
            return float(np.abs(np.asarray(found) / wanted() - 1).max())

        return Case((scene, FEW), error)

    m, scene = TIMES.size, bearings_scene(TRACK.sigma)
    limit = Limit(
        {"sincos": m, "fma": 6.0 * m},
        "a sine, a cosine and six sums for each bearing; random numbers are whole-number work and "
        "not counted",
    )
    return Contest(
        f"Monte Carlo of bearings Gram + log det, {trials} trials, m = {m}",
        "trial",
        float(trials),
        (scene, trials),
        [
            *ours(limit, quantities=["gram_logdet"]),
            Contestant("gramian, the kernel alone", kernel, limit=limit),
        ],
        cases={"well": case(scene), "ill": case(bearings_scene(1e-9, turn=1e-3))},
        target="at most 1.2 times the kernel, two threads at least 1.8 times one",
        note="Ill: an almost straight path, bearings of 1e-9 rad.",
    )


def likelihood_contest(
    what: str,
    scenes: Sequence[Any],
    trials: int,
    peers: dict[str, tuple[Callable[[Any], Callable[[Any], Any]], int]],
    most_likely: Callable[[Any, Any], Any],
    limit: Limit,
    *,
    target: str = "",
    note: str = "",
) -> Contest:
    """Maximum likelihood of the first scene, simulation included; the second is the ill one.

    `peers` make an estimator for a scene, and are given so many trials.
    """

    def looped(make: Callable[[Any], Callable[[Any], Any]], few: int) -> Any:
        def prepare(data: Any) -> Callable[[], Any]:
            scene, trials = data
            estimate, given = make(scene), scene.simulate(1, 0, min(trials, few))
            return lambda: [estimate(z) for z in given]

        return prepare

    def case(scene: Any) -> Case:
        wanted = exact.lazily(lambda: [most_likely(scene, z) for z in scene.simulate(1, 0, FEW)])

        def error(found: Any) -> float:
            if isinstance(found, mc.MonteCarloResult):
                errors = [found.sample[f"error_{name}"] for name in scene.names]
                found = scene.truth + np.stack(errors, axis=1)
            return float((np.abs(found - np.array(wanted())) / gm.crlb_std(scene.problem())).max())

        return Case((scene, FEW), error)

    return Contest(
        f"{what} maximum likelihood, simulation included",
        "trial",
        float(trials),
        (scenes[0], trials),
        [
            *ours(limit),
            *(
                Contestant(name, looped(make, few), part=float(few))
                for name, (make, few) in peers.items()
            ),
        ],
        cases=dict(zip(("well", "ill"), map(case, scenes), strict=True)),
        target=target,
        note=f"Error: distance from the most likely state in deviations of the bound; {note}.",
    )


def bearings_contest(trials: int, few: int) -> Contest:
    """Beside a loop over SciPy, and one over Stone Soup's Jacobians."""
    return likelihood_contest(
        f"bearings, m = {TIMES.size},",
        [bearings_scene(TRACK.sigma), bearings_scene(10 * TRACK.sigma)],
        trials,
        {
            "SciPy least_squares in a loop, its defaults": (
                lambda _: TRACK.by_scipy(plain=True),
                few,
            ),
            "SciPy MINPACK with the analytic Jacobian": (lambda _: TRACK.by_scipy(), few),
            "Gauss-Newton on Stone Soup's Jacobians": (stone_soup_estimator, max(2, few // 20)),
        },
        lambda _, z: TRACK.most_likely(z),
        bench_localize.limit(TIMES.size),
        target="80 000 trials a second, two threads at least 1.8 times one; 400 times SciPy, 1000 "
        "times Stone Soup",
        note="ill: bearings of 1 deg",
    )


def compiled_contest(trials: int, few: int) -> Contest:
    """The same function of the user's own, compiled by numba and in Python."""

    def python(x: Any) -> Any:
        east = x[0] + TIMES * x[2] - PATH[:, 0]
        north = x[1] + TIMES * x[3] - PATH[:, 1]
        return np.arctan2(east, north)

    def compiled() -> Any:
        import numba

        times, path = TIMES.copy(), np.ascontiguousarray(PATH)

        @numba.cfunc("void(CPointer(float64), CPointer(float64))")
        def h(x: Any, z: Any) -> None:
            for i in range(times.size):
                east = x[0] + times[i] * x[2] - path[i, 0]
                z[i] = np.arctan2(east, x[1] + times[i] * x[3] - path[i, 1])

        return h

    def model(h: Any, sigma: float) -> Any:
        names = ["x0", "y0", "vx", "vy"]
        count = None if h is python else TIMES.size
        return gm.from_function(h, STATE, sigma, names, angles=True, measurements=count)

    def by(make: Callable[[], Any], workers: int, part: int | None = None) -> Any:
        def prepare(data: Any) -> Callable[[], Any]:
            sigma, trials = data
            scene = mc.Measurements(model(make(), sigma))
            return lambda: run((scene, min(trials, part or trials)), workers=workers)

        return prepare

    def by_scipy(data: Any) -> Callable[[], Any]:
        sigma, trials = data
        estimate, given = TRACK.by_scipy(plain=True), model(python, sigma)
        z = given.simulate(None, 1, min(trials, few))
        return lambda: [estimate(one) for one in z]

    def case(sigma: float) -> Case:
        scene = mc.Measurements(model(python, sigma))
        bound = gm.crlb_std(scene.problem())
        wanted = exact.lazily(lambda: [TRACK.most_likely(z) for z in scene.simulate(1, 0, FEW)])

        def error(found: Any) -> float:
            if isinstance(found, mc.MonteCarloResult):
                errors = [found.sample[f"error_{name}"] for name in scene.names]
                found = STATE + np.stack(errors, axis=1)
            return float((np.abs(np.asarray(found)[:FEW] - np.array(wanted())) / bound).max())

        return Case((sigma, FEW), error)

    return Contest(
        f"Monte Carlo of a function of one's own, bearings, m = {TIMES.size}",
        "trial",
        float(trials),
        (TRACK.sigma, trials),
        [
            Contestant(OURS, by(compiled, 1)),
            Contestant("gramian, all threads", by(compiled, ALL), threads=ALL),
            Contestant(
                "gramian, the same function in Python",
                by(lambda: python, 1, few),
                part=float(few),
            ),
            Contestant("SciPy least_squares in a loop, its defaults", by_scipy, part=float(few)),
        ],
        cases={"well": case(TRACK.sigma), "ill": case(10 * TRACK.sigma)},
        target="20 times the function in Python",
        note="Compiled by numba.cfunc. Error: distance from the most likely state in deviations of "
        "the bound; ill: bearings of 1 deg.",
    )


def least_squares() -> Any:
    """Gauss-Newton on bearings from a pseudo-linear start, compiled by numba; its first step."""
    import numba

    times, path = TIMES.copy(), np.ascontiguousarray(PATH)

    @numba.njit
    def solve(a: Any, x: Any) -> None:
        for j in range(4):
            for k in range(j):
                a[j, k] = a[k, j]
        for p in range(4):
            for j in range(p + 1, 4):
                factor = a[j, p] / a[p, p]
                for k in range(p, 5):
                    a[j, k] -= factor * a[p, k]
        for p in range(3, -1, -1):
            value = a[p, 4]
            for k in range(p + 1, 4):
                value -= a[p, k] * x[k]
            x[p] = value / a[p, p]

    @numba.njit
    def add(a: Any, row: Any, time: float) -> None:
        row[2], row[3] = time * row[0], time * row[1]
        for j in range(4):
            for k in range(j, 5):
                a[j, k] += row[j] * row[k]

    @numba.njit
    def pseudo_linear(z: Any, x: Any) -> None:
        a, row = np.zeros((4, 5)), np.zeros(5)
        for i in range(times.size):
            row[0], row[1] = np.cos(z[i]), -np.sin(z[i])
            row[4] = path[i, 0] * row[0] + path[i, 1] * row[1]
            add(a, row, times[i])
        solve(a, x)

    @numba.cfunc("void(CPointer(float64), CPointer(float64))")
    def start(z: Any, x: Any) -> None:
        pseudo_linear(z, x)

    @numba.cfunc("int32(CPointer(float64), CPointer(float64))")
    def whole(z: Any, x: Any) -> int:
        pseudo_linear(z, x)
        step, row = np.zeros(4), np.zeros(5)
        for _ in range(STEPS):
            a = np.zeros((4, 5))
            for i in range(times.size):
                east = x[0] + times[i] * x[2] - path[i, 0]
                north = x[1] + times[i] * x[3] - path[i, 1]
                squared = east * east + north * north
                left = z[i] - np.arctan2(east, north)
                row[0], row[1] = north / squared, -east / squared
                row[4] = left - 2 * np.pi * np.round(left / (2 * np.pi))
                add(a, row, times[i])
            solve(a, step)
            small = True
            for j in range(4):
                x[j] += step[j]
                small = small and abs(step[j]) < SMALL * (1 + abs(x[j]))
            if small:
                return 0
        return 1

    return start, whole


STEPS, SMALL = 30, 1e-8  # of Gauss-Newton: at most, and of which length the last is


def gauss_newton(z: Any) -> Any:
    """The same in Python."""
    x = TRACK.pseudo_linear(z)
    for _ in range(STEPS):
        step = np.linalg.lstsq(TRACK.jacobian(x), -TRACK.residual(x, z), rcond=None)[0]
        x = x + step
        if (np.abs(step) < SMALL * (1 + np.abs(x))).all():
            return x
    raise ArithmeticError("not converged")


def estimator_contest(trials: int, few: int, *, whole: bool) -> Contest:
    """An estimator of the user's own, compiled by numba and in Python."""
    python = gauss_newton if whole else TRACK.pseudo_linear

    def compiled(workers: int) -> Callable[[Any], Callable[[], Any]]:
        def prepare(data: Any) -> Callable[[], Any]:
            estimator = least_squares()[whole]
            return lambda: run(data, estimator=estimator, workers=workers)

        return prepare

    def in_python(data: Any) -> Callable[[], Any]:
        scene, trials = data
        return lambda: run((scene, min(trials, few)), estimator=python)

    def case(sigma: float) -> Case:
        scene = bearings_scene(sigma)
        bound = gm.crlb_std(scene.problem())
        likely = TRACK.most_likely if whole else exact_pseudo_linear
        wanted = exact.lazily(lambda: [likely(z) for z in scene.simulate(1, 0, FEW)])

        def error(found: Any) -> float:
            errors = [found.sample[f"error_{name}"] for name in scene.names]
            states = STATE + np.stack(errors, axis=1)
            return float((np.abs(states[:FEW] - np.array(wanted())) / bound).max())

        return Case((scene, FEW), error)

    what = "maximum likelihood by Gauss-Newton" if whole else "pseudo-linear least squares"
    return Contest(
        f"Monte Carlo of an estimator of one's own, {what}, m = {TIMES.size}",
        "trial",
        float(trials),
        (bearings_scene(TRACK.sigma), trials),
        [
            Contestant(OURS, compiled(1)),
            Contestant("gramian, all threads", compiled(ALL), threads=ALL),
            Contestant("gramian, the same estimator in Python", in_python, part=float(few)),
        ],
        cases={"well": case(TRACK.sigma), "ill": case(10 * TRACK.sigma)},
        target="20 times the estimator in Python",
        note="Compiled by numba.cfunc, simulation and statistics included. Error: distance from "
        "its exact answer in deviations of the bound; ill: bearings of 1 deg.",
    )


def exact_pseudo_linear(z: Any) -> Any:
    """The pseudo-linear estimate with 30 digits."""
    import mpmath as mp

    with mp.workdps(30):
        rows, right = mp.zeros(len(z), 4), mp.zeros(len(z), 1)
        for i, angle in enumerate(z):
            c, s, time = mp.cos(mp.mpf(angle)), mp.sin(mp.mpf(angle)), mp.mpf(TIMES[i])
            for j, entry in enumerate([c, -s, time * c, -time * s]):
                rows[i, j] = entry
            right[i] = mp.mpf(PATH[i, 0]) * c - mp.mpf(PATH[i, 1]) * s
        return np.array([float(x) for x in mp.lu_solve(rows.T * rows, rows.T * right)])


def stone_soup_estimator(_: Any, steps: int = 5) -> Callable[[Any], Any]:
    """Gauss-Newton steps with the measurement model and Jacobian of Stone Soup."""
    samples = bench_bearings.stone_soup_samples(TIMES, PATH, TRACK.sigma)

    def estimate(z: Any) -> Any:
        x = TRACK.pseudo_linear(z)
        for _ in range(steps):
            models, states, rows = zip(*samples(x), strict=True)
            seen = [m.function(at, noise=False)[0, 0] for m, at in zip(models, states, strict=True)]
            left = z - np.pi / 2 + np.array(seen, dtype=float)
            left = (left + np.pi) % (2 * np.pi) - np.pi
            x = x + np.linalg.lstsq(np.array(rows), left / TRACK.sigma, rcond=None)[0]
        return x

    return estimate


def dipole_contest(trials: int, few: int) -> Contest:
    """Locating a dipole with z0 and vz known, beside a loop over SciPy started at the truth."""
    times = np.arange(21.0)

    def scene(state: Any, sigma: float) -> Any:
        return mc.Dipole(*np.split(state, 3), times, sigma, known=["z0", "vz"])

    def whole(scene: Any) -> Any:
        return np.concatenate([scene.r0, scene.v, scene.m])

    return likelihood_contest(
        "dipole, 21 samples, z0 and vz known,",
        [scene(bench_dipole.table_1(1.0), 1e-9), scene(bench_dipole.table_1(4.0), 1e-12)],
        trials,
        {
            "SciPy least_squares from the truth": (
                lambda scene: lambda z: bench_dipole.by_scipy(times, z, whole(scene)),
                few,
            )
        },
        lambda scene, z: bench_dipole.most_likely(times, z, whole(scene)),
        bench_dipole.LOCATE,
        note="ill: four times as far away, a thousandth of the noise",
    )


def registration_contest(trials: int, few: int) -> Contest:
    """Registration biases of two radars, beside a loop over SciPy with sparse Jacobians."""
    reg = bench_registration

    def scene(north: float) -> Any:
        return mc.Registration(
            reg.TARGET_A + np.array([0.0, north]), reg.SENSORS, reg.SIGMA, reg.BIASES
        )

    return likelihood_contest(
        f"registration, {len(reg.TARGET_A)} looks,",
        [scene(0.0), scene(60e3)],
        trials,
        {
            "SciPy least_squares, sparse": (
                lambda _: lambda z: reg.scipy_ml(z, sparse=True),
                few,
            )
        },
        lambda _, z: reg.exact_estimate(z),
        reg.estimate_limit(len(reg.TARGET_A)),
        note="ill: the target 60 km farther away",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield log_det_contest(200_000 if quick else 1_000_000)
    yield bearings_contest(*((20_000, 40) if quick else (200_000, 200)))
    yield compiled_contest(*((2000, 20) if quick else (20_000, 50)))
    for whole in (False, True):
        yield estimator_contest(*((20_000, 200) if quick else (200_000, 1000)), whole=whole)
    yield dipole_contest(*((200, 10) if quick else (2000, 50)))
    yield registration_contest(*((500, 2) if quick else (5000, 10)))


if __name__ == "__main__":
    main(contests)
