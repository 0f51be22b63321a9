"""Ranks beside large coordinates and times since 1970: straight paths stay unobservable."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor, estimate, problem, simulate


def setting(rng):
    """Times, their offset, origin and speed of an observer, in units that people use."""
    times = np.sort(rng.uniform(0.0, 10 ** rng.uniform(1, 4), int(rng.integers(20, 60))))
    since = rng.choice([0.0, 1.7e9])
    unit = rng.choice([1.0, 1e-3, 1e3, 1 / 1852])
    origin = unit * rng.choice([0.0, 1e3, 1e5, 1e7]) * rng.normal(size=2)
    return times, since, origin, unit * 10 ** rng.uniform(0, 2)


def heading(rng):
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.sin(angle), np.cos(angle)])


def straight(rng, kind):
    """A scene that is unobservable in exact arithmetic, and a state of it."""
    times, since, origin, speed = setting(rng)
    span = times[-1]
    order = {"accelerated": 2, "of order 3": 3}.get(kind, 1)
    along = speed * heading(rng)
    # An observer that moves as the target may: of the same order in time.
    terms = [along] + [speed / span**k * rng.normal(size=2) for k in range(1, order)]
    path = origin + sum(v * (times[:, None] ** (k + 1) / [1, 2, 6][k]) for k, v in enumerate(terms))
    stamps = times + since
    carrier = Carrier(path, stamps)
    if kind == "between two ends":
        carrier = Carrier([origin, origin + along * span], [since, since + span])
    if kind == "range rate":
        sensors = [Sensor.range_rate(carrier, stamps, sigma=0.01 * speed)]
    elif kind == "biased":
        sensors = [
            Sensor.bearing(carrier, stamps, sigma=0.01, bias="compass"),
            Sensor.range(carrier, stamps, sigma=0.002 * speed * span),
        ]
    else:
        sensors = [Sensor.bearing(carrier, stamps, sigma=10 ** rng.uniform(-4, -1.5))]
    away = speed * span * 10 ** rng.uniform(-0.7, 1)
    state = [path[0] + away * heading(rng)]
    state += [speed / span ** (k - 1) * rng.normal(size=2) for k in range(1, order + 1)]
    if kind == "on one line":
        state = [path[0] + along * span * rng.uniform(1.2, 4), along * rng.uniform(-1, 0.2)]
    if kind == "biased":
        # Far enough for ranges that are none but positive.
        state[0] = path[0] + 10 * speed * span * heading(rng)
        state.append([0.02])
    return Scene(Motion.polynomial(order), sensors), np.concatenate(state)


@pytest.mark.parametrize(
    "kind",
    [
        "straight",
        "between two ends",
        "on one line",
        "accelerated",
        "of order 3",
        "range rate",
        "biased",
    ],
)
def test_straight_observers_are_unobservable(kind):
    """Wherever the steps end: at the observer itself, at infinity, or between."""
    rng = np.random.default_rng(7)
    ended = []
    for trial in range(40):
        scene, state = straight(rng, kind)
        assert gm.analyze(problem(scene, state)).status == "unobservable", trial
        found = estimate(scene, simulate(scene, state, seed=trial))
        assert found.status == "unobservable", (trial, str(found))
        ended.append(np.hypot(*(found.state[:2] - scene.sensors[0].carrier.path[0])))
    if kind == "straight":
        # Some of them within a millionth of the way of the observer.
        assert min(ended) < 1e-6


def zigzag(rng, sensor):
    times, since, origin, speed = setting(rng)
    count = int(rng.integers(2, 5))
    knots = np.linspace(0.0, times[-1], count + 1)
    course = np.cumsum(rng.uniform(0.3, 2.5, count) * rng.choice([-1, 1], count))
    steps = speed * np.diff(knots)[:, None] * np.stack([np.sin(course), np.cos(course)], axis=1)
    path = origin + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    carrier = Carrier(path, knots + since)
    away = speed * times[-1] * 10 ** rng.uniform(-1, 2)
    state = np.concatenate([path[0] + away * heading(rng), speed * rng.normal(size=2)])
    scale = {"bearing": 0.003, "range": 0.01 * speed * times[-1], "range_rate": 0.01 * speed}
    made = getattr(Sensor, sensor)(carrier, times + since, sigma=scale[sensor])
    return Scene(Motion.constant_velocity(), [made]), state


@pytest.mark.parametrize("sensor", ["bearing", "range", "range_rate"])
def test_what_a_turn_shows_is_no_rounding(sensor):
    """The tolerance stays far below the least singular value, at long ranges too."""
    rng = np.random.default_rng(8)
    for trial in range(60):
        scene, state = zigzag(rng, sensor)
        plain = gm.analyze(gm.Problem(gm.tracks.rows(scene, state), scene.names))
        asked = problem(scene, state)
        found = gm.analyze(asked)
        assert found.rank == plain.rank == 4, trial
        np.testing.assert_allclose(found.crlb_std, plain.crlb_std, rtol=1e-9)
        scaled = asked.rows / np.linalg.norm(asked.rows, axis=0)
        values = np.linalg.svd(scaled, compute_uv=False)
        assert values[-1] / values[0] > 30 * (asked.rtol or 0.0), trial
        # Without noise: with it the most likely range may be infinite.
        found = estimate(scene, scene.values(state), start=state)
        assert found.status != "unobservable", trial


def test_a_known_tolerance_is_taken_as_it_is():
    """`rtol` of the caller stands in the place of what rounding would make it."""
    rng = np.random.default_rng(9)
    scene, state = straight(rng, "straight")
    z = simulate(scene, state, seed=1)
    assert estimate(scene, z).status == "unobservable"
    scene, state = zigzag(rng, "bearing")
    z = simulate(scene, state, seed=1)
    assert estimate(scene, z).status != "unobservable"
    assert estimate(scene, z, rtol=0.5).status == "unobservable"
