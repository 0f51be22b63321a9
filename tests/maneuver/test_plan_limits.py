"""Every limit of a plan is kept by the path that is returned, whatever limits come together.

The checks are written anew from the headings and speeds of the answer: they share nothing with
the planner but the definition of each limit.
"""

import dataclasses

import numpy as np
import pytest

import gramian as gm

#: Metres and radians that rounding may take.
SLACK = 1e-6


def flown(plan, start, dt, current):
    """Follow headings and speeds from the starts: (observers, samples, 2)."""
    headings, speeds = np.atleast_2d(plan.headings), np.atleast_2d(plan.speeds)
    water = speeds[..., None] * np.stack([np.sin(headings), np.cos(headings)], axis=-1)
    starts = np.atleast_2d(np.asarray(start, dtype=float))
    steps = dt * (water + current)
    return np.concatenate([starts[:, None], starts[:, None] + np.cumsum(steps, axis=1)], axis=1)


def dense(path, parts=200):
    """Points along the straight moves of a path."""
    share = np.linspace(0, 1, parts)[:, None, None]
    return ((1 - share) * path[:-1] + share * path[1:]).reshape(-1, 2)


def depth(points, corners):
    """How far inside of a polygon each point is: the winding number and the nearest edge."""
    corners = np.asarray(corners, dtype=float)
    spokes = corners[None] - points[:, None]
    angles = np.arctan2(spokes[..., 1], spokes[..., 0])
    turns = np.diff(np.concatenate([angles, angles[:, :1]], axis=1), axis=1)
    winding = ((turns + np.pi) % (2 * np.pi) - np.pi).sum(axis=1)
    inside = np.abs(winding) > np.pi
    edges = np.roll(corners, -1, axis=0) - corners
    part = np.clip(-(spokes * edges).sum(axis=2) / (edges**2).sum(axis=1), 0, 1)
    nearest = np.hypot(*np.moveaxis(spokes + part[..., None] * edges, 2, 0)).min(axis=1)
    return np.where(inside, nearest, 0.0)


def broken(plan, given, limits):
    """By how much each limit is broken, in its own unit: an empty dict where all are kept."""
    target, start, speed, dt, samples = given
    targets = np.asarray(target, dtype=float)
    targets = targets.reshape(-1, targets.shape[-1])
    slow, fast = speed if isinstance(speed, tuple) else (speed, speed)
    current = np.asarray(limits.get("current", (0.0, 0.0)), dtype=float)
    paths = flown(plan, start, dt, current)
    told = plan.path if plan.path.ndim == 3 else plan.path[None]
    headings, speeds = np.atleast_2d(plan.headings), np.atleast_2d(plan.speeds)
    excess = {
        "the path is that of its headings": np.abs(paths - told).max() / np.abs(told).max(),
        "slow": slow - speeds.min(),
        "fast": speeds.max() - fast,
    }
    times = dt * np.arange(samples)
    for state in targets:
        velocity = state[2:] if len(state) == 4 else np.zeros(2)
        away = told[:, 1:] - (state[:2] + times[1:, None] * velocity)
        excess["standoff"] = max(
            excess.get("standoff", -np.inf),
            plan.standoff - np.hypot(away[..., 0], away[..., 1]).min(),
        )
    for path in told:
        points = dense(path)
        for east, north, radius in limits.get("keep_out", []):
            inside = radius - np.hypot(*(points - [east, north]).T).min()
            excess["keep_out"] = max(excess.get("keep_out", -np.inf), inside)
        for corners in limits.get("polygons", []):
            inside = depth(points, corners).max()
            excess["polygons"] = max(excess.get("polygons", -np.inf), inside)
    if "max_turn_rate" in limits:
        first = [[limits["heading"]]] * len(told) if "heading" in limits else headings[:, :1]
        turns = np.diff(np.concatenate([first, headings], axis=1), axis=1)
        turns = np.abs((turns + np.pi) % (2 * np.pi) - np.pi)
        excess["max_turn_rate"] = turns.max() - limits["max_turn_rate"] * dt
    if "return_to" in limits:
        home = np.asarray(limits["return_to"], dtype=float)
        within = home[2] if len(home) == 3 else fast * dt
        excess["return_to"] = np.hypot(*(told[:, -1] - home[:2]).T).max() - within
    if "max_distance" in limits:
        excess["max_distance"] = (speeds.sum(axis=1) * dt).max() - limits["max_distance"]
    if "separation" in limits:
        gaps = [np.hypot(*(a - b).T).min() for i, a in enumerate(told) for b in told[i + 1 :]]
        excess["separation"] = limits["separation"] - min(gaps)
    if "legs" in limits:
        turned = np.abs(np.diff(np.unwrap(headings, axis=1), axis=1)) > 1e-12
        excess["legs"] = float(turned.any(axis=0).sum() - (limits["legs"] - 1))
    return {name: value for name, value in excess.items() if value > SLACK}


def scene_of(rng):
    """Return a random scene whose limits can be kept, several of them together."""
    samples, step = int(rng.integers(20, 40)), 20.0
    moving = rng.random() < 0.5
    state = [rng.uniform(-150, 150), rng.uniform(450, 900), *rng.uniform(-5, 5, 2)]
    target = np.array(state[: 4 if moving else 2])
    start = [0.0, 0.0]
    limits = {"standoff": float(rng.uniform(150, 300)), "sigma": 0.01}
    speed = step
    chosen = rng.random(9) < 0.4
    if chosen[0]:
        limits["keep_out"] = [[*rng.uniform((-150, 120), (150, 250)), rng.uniform(40, 100)]]
    if chosen[1]:
        center, angles = rng.uniform((-250, -50), (250, 350)), np.sort(rng.uniform(0, 6.28, 6))
        center += 180 * center / np.hypot(*center)
        radii = rng.uniform(40, 120, 6)[:, None]
        limits["polygons"] = [center + radii * np.stack([np.sin(angles), np.cos(angles)], axis=1)]
    if chosen[2]:
        limits["max_turn_rate"] = float(np.radians(rng.uniform(8, 30)))
        limits["heading"] = float(rng.uniform(-1, 1))
    if chosen[3]:
        speed = (8.0, step)
    if chosen[4]:
        limits["return_to"] = [*rng.uniform(-150, 150, 2), 30.0]
    if chosen[5]:
        limits["current"] = rng.uniform(-3, 3, 2)
    if chosen[6]:
        start = [[0.0, 0.0], [100.0, -20.0]]
        # Both fit into the place to return to.
        limits["separation"] = float(rng.uniform(20, 55))
    if chosen[7]:
        limits["legs"] = int(rng.integers(2, 6))
        limits.pop("max_turn_rate", None)
    if chosen[8]:
        speed = (8.0, step)
        limits["max_distance"] = 0.8 * step * (samples - 1)
    return (target, start, speed, 1.0, samples), limits


@pytest.mark.parametrize("seed", range(12))
def test_all_limits_of_a_random_scene_are_kept(seed):
    given, limits = scene_of(np.random.default_rng(seed))
    plan = gm.maneuver.plan(*given, starts=3, restarts=2, **limits)
    assert not broken(plan, given, limits)
    assert plan.violations == ()
    assert plan.gap >= 1


def test_the_checks_see_what_is_broken():
    # A path straight through everything.
    limits = {"standoff": 300.0, "keep_out": [[0.0, 120.0, 30.0]], "sigma": 0.01}
    limits["polygons"] = [[[-20, 200], [20, 200], [20, 240], [-20, 240]]]
    given = ([0.0, 500.0], [0.0, 0.0], 20.0, 1.0, 20)
    plan = gm.maneuver.plan(*given, standoff=1.0, legs=1, heading=0.0, max_turn_rate=1e-6)
    plan = dataclasses.replace(plan, standoff=300.0)
    assert set(broken(plan, given, limits)) == {"standoff", "keep_out", "polygons"}


GIVEN = ([0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 20)


@pytest.mark.parametrize(
    ("change", "limits", "said"),
    [
        # Straight at the circle, with a turn too slow to miss it.
        (
            {},
            {"keep_out": [[900.0, 0, 9.0], [0, 60, 50]], "heading": 0.0, "max_turn_rate": 0.05},
            {"keep_out", "max_turn_rate"},
        ),
        # A wall on all sides.
        (
            {},
            {"keep_out": [[30 * np.sin(a), 30 * np.cos(a), 25] for a in np.arange(0, 6, 1.05)]},
            {"keep_out"},
        ),
        # One leg at one speed ends where it ends.
        ({}, {"legs": 1, "return_to": [0.0, 0.0, 50.0]}, {"return_to"}),
        # A target that runs over an observer that is too slow.
        ({"target": [0, 400, 0, -40.0], "speed": 1.0}, {"standoff": 100.0}, {"standoff"}),
        # Turns about.
        (
            {"speed": (5.0, 20.0)},
            {"heading": 0.0, "max_turn_rate": 0.02, "max_distance": 120.0,
             "return_to": [0, -80, 20.0]},
            {"return_to", "max_turn_rate", "max_distance"},
        ),
    ],
)  # fmt: skip
def test_limits_that_cannot_be_kept_are_named(change, limits, said):
    given = dict(zip(("target", "start", "speed", "dt", "samples"), GIVEN, strict=True)) | change
    plan = gm.maneuver.plan(*given.values(), sigma=0.01, starts=4, restarts=2, **limits)
    assert not plan.converged
    named = {one.limit for one in plan.violations}
    assert named
    assert named <= said
    for one in plan.violations:
        assert one.by > 0
        assert one.limit in plan.message
    assert {v["limit"] for v in plan.to_dict()["violations"]} == named
    # What is said is what an independent check finds.
    found = broken(plan, tuple(given.values()), limits)
    assert set(found) == named
    for name in named:
        most = max(one.by for one in plan.violations if one.limit == name)
        # Points along the path come within a hundredth of a move of the worst one.
        assert found[name] == pytest.approx(most, rel=1e-3, abs=0.1)
    assert np.isnan(plan.gap)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"return_to": [500.0, 0.0]}, "a path of 380 m does not reach it within 20 m"),
        (
            {"return_to": [200.0, 0.0, 10.0], "speed": (5.0, 20.0), "max_distance": 150.0},
            "a path of 150 m does not reach it",
        ),
        (
            {"return_to": [300.0, 0.0], "current": [-10.0, 0.0]},
            "from start that the current leaves, 490 m",
        ),
        (
            {"return_to": [0.0, 300.0, 5.0], "keep_out": [[0.0, 300.0, 50.0]]},
            r"return_to is inside keep_out\[0\]",
        ),
        ({"return_to": [0.0, 350.0, 5.0], "standoff": 700.0}, "inside standoff = 700 m"),
        (
            {"start": [[0.0, 0.0], [100.0, 0.0]], "separation": 90.0, "return_to": [0, 100, 30.0]},
            "observers there are at most 60 m apart",
        ),
    ],
)
def test_limits_that_contradict_each_other_are_refused(limits, words):
    given = dict(zip(("target", "start", "speed", "dt", "samples"), GIVEN, strict=True))
    given |= {name: limits.pop(name) for name in list(limits) if name in given}
    with pytest.raises(gm.InputError, match=words):
        gm.maneuver.plan(*given.values(), **limits)


def test_a_current_carries_the_observer_home():
    # 418 m away: beyond 380 m through the water, within reach with the current.
    plan = gm.maneuver.plan(*GIVEN, current=[3.0, 0.0], return_to=[418.0, 0.0, 10.0])
    assert plan.converged
    assert np.hypot(*(plan.path[-1] - [418.0, 0.0])) <= 10.0 + 1e-6


def test_the_bound_knows_the_way_home():
    # So the gap of a path that must return is not that of one that need not.
    home = gm.maneuver.plan(*GIVEN, standoff=300.0, return_to=[0.0, 0.0, 10.0])
    free = gm.maneuver.plan(*GIVEN, standoff=300.0)
    assert home.value <= home.bound < free.value
    assert home.gap < 2


def test_nothing_is_seen_in_a_blind_arc():
    arc = (np.radians(150), np.radians(210))
    target = np.array([0.0, -600.0])
    sensor = gm.maneuver.Sensing("bearing", 0.01, blind=[arc])
    plan = gm.maneuver.plan(target, [0.0, 0.0], 20.0, 1.0, 30, sensors=[sensor], standoff=300.0)
    headings = np.concatenate([plan.headings[:1], plan.headings])
    offset = target - plan.path
    relative = (np.arctan2(*offset.T) - headings) % (2 * np.pi)
    seen = (relative < arc[0]) | (relative > arc[1])
    rows = offset[:, ::-1] * [1, -1] / (0.01 * (offset**2).sum(axis=1)[:, None])
    # What the plan counts is what is seen outside of the arc, and that alone.
    value = np.linalg.slogdet(rows[seen].T @ rows[seen])[1]
    assert plan.value == pytest.approx(value, rel=1e-9)
    assert seen.mean() > 0.9
