"""The planner beats the closed-form laws, keeps its limits, and says what it found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm
from gramian import _core
from gramian.models.maneuver._task import Task

TARGET, START, SPEED, DT, SIGMA = [0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 0.001**0.5
#: Best determinants found by 60 starts of a general optimiser, and the law max_det's.
BEST = {
    (40, 800.0): (2.05985e-4, 8.390e-5),
    (40, 500.0): (6.31117e-4, 8.390e-5),
    (100, 800.0): (5.40373e-3, 2.3151e-3),
    (100, 500.0): (3.0366e-2, 2.3151e-3),
}


@pytest.fixture(scope="module", params=list(BEST), ids=str)
def case(request):
    samples, standoff = request.param
    plan = gm.maneuver.plan(
        TARGET, START, SPEED, DT, samples, criterion="D", sigma=SIGMA, standoff=standoff
    )
    return plan, standoff, BEST[request.param]


def test_the_determinant_is_the_best_known(case):
    plan, _, (best, law) = case
    assert plan.determinant >= 0.995 * best
    assert plan.converged
    found = {one.law: one for one in plan.laws}
    assert np.exp(found["max_det"].value) == pytest.approx(law, rel=1e-4)
    assert found["max_det"].behind == pytest.approx(plan.determinant / law, rel=1e-4)


def test_the_stand_off_is_hard(case):
    plan, standoff, _ = case
    ranges = np.hypot(*(plan.path - TARGET).T)
    assert ranges.min() >= standoff
    assert plan.clearance == pytest.approx(ranges[1:].min() - standoff, abs=1e-9)
    moves = np.diff(plan.path, axis=0)
    np.testing.assert_allclose(np.hypot(*moves.T), SPEED * DT, rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(*moves.T), plan.headings, atol=1e-9)


def test_the_criterion_along_the_path_is_that_of_the_rows(case):
    plan, _, _ = case
    offset = np.array(TARGET) - plan.path
    rows = offset[:, ::-1] * [1, -1] / (SIGMA * (offset**2).sum(axis=1)[:, None])
    assert plan.values[0] == -np.inf
    for k in (2, 20, len(rows)):
        expected = np.linalg.slogdet(rows[:k].T @ rows[:k])[1]
        assert plan.values[k - 1] == pytest.approx(expected, rel=1e-9)
    # One is summed by its factor, the other by blocks of rows.
    assert plan.values[-1] == pytest.approx(plan.value, rel=1e-13)
    np.testing.assert_allclose(plan.crlb_std[0], gm.crlb_std(rows), rtol=1e-9)


def test_which_local_optimum_is_said(case):
    plan, _, _ = case
    values = [start.value for start in plan.starts]
    assert plan.starts[0].value == plan.value == max(values)
    assert 1 == plan.optimum <= plan.optima <= len(plan.starts) <= plan.guesses
    assert f"local optimum 1 of {plan.optima}" in plan.summary()
    assert plan.to_dict()["starts"][0]["converged"] is True


CRITERIA = ["D", "A", "E", "combination"]


def search(kind, targets, moves, *, sensors=None, starts=((5.0, -3.0),), legs=None, sigma=0.02):
    """The planner's criterion on its own, without a search."""
    targets = np.atleast_2d(np.asarray(targets, dtype=float))
    weights = np.arange(1.0, 1 + len(targets))
    criterion = {"combination": [0.3, 1.0, 5.0, -2.0][: targets.shape[1]]}
    task = Task.checked(
        target=targets, start=starts, speed=(10.0, 30.0), dt=1.5, samples=moves + 1,
        criterion=criterion if kind == "combination" else kind,
        sigma=None if sensors else sigma, sensors=sensors, belief=None, over="expectation",
        standoff=0.0, keep_out=None, polygons=None, max_turn_rate=None, heading=None, legs=legs,
        return_to=None, max_distance=None, separation=None, current=(0.7, -0.4), prior=None,
        weights=weights, scale=None,
    )  # fmt: skip
    return _core.PlanSearch(task.problem(), 1, 0, 1, 0)


SENSINGS = {
    "bearing": [gm.maneuver.Sensing("bearing", 0.02, bias="compass")],
    "bearing and rate": [
        gm.maneuver.Sensing("bearing", 0.02, blind=[(2.6, 3.7)], detection=0.8),
        gm.maneuver.Sensing("range_rate", 0.5),
    ],
    "frequency": [
        gm.maneuver.Sensing("bearing", 0.02),
        gm.maneuver.Sensing(
            "frequency", 0.1, parameters={"tonal": 300.0}, unknown={"tonal": "tonal"}
        ),
    ],
    "towed array": [gm.maneuver.Sensing("cone_angle", 0.02, blind=[(2.9, 3.4)])],
    "range": [
        gm.maneuver.Sensing("range", 5.0, reach=2000.0),
        gm.maneuver.Sensing("signal_strength", 1.0, parameters={"power": 100.0}),
    ],
}


@pytest.mark.parametrize("sensors", [None, *SENSINGS], ids=str)
@pytest.mark.parametrize("kind", CRITERIA)
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**31), moving=st.booleans(), several=st.booleans())
def test_gradients_agree_with_differences(kind, sensors, seed, moving, several):
    rng = np.random.default_rng(seed)
    counts = np.array([3, 1, 4, 2, 5, 6])
    targets = rng.uniform(-300, 300, (2 if several else 1, 4 if moving else 2))
    targets[:, 1] = rng.uniform(800, 1500, len(targets))
    targets[:, 2:] /= 40
    if kind == "combination" and sensors in ("bearing", "frequency"):
        kind = "A"
    ask = search(kind, targets, 21, sensors=SENSINGS.get(sensors), starts=((5, -3), (200, 40)))
    headings = rng.uniform(-1.5, 1.5, (2, 6)) + np.array([1.2, -1.2, 0.5, 2.0, -0.5, 1.0])
    speeds = rng.uniform(15, 25, (2, 6))
    _, (by_heading, by_speed) = ask.gradient(counts, headings, speeds, 6.0)

    def differences(move):
        h = 1e-5  # edges of fields of view are steep
        points = [ask.gradient(counts, *move(step * h), 6.0)[0] for step in (-3, -2, -1, 1, 2, 3)]
        return np.dot(points, [-1 / 60, 3 / 20, -3 / 4, 3 / 4, -3 / 20, 1 / 60]) / h

    for found, move in (
        (by_heading, lambda x, unit: (headings + x * unit, speeds)),
        (20 * by_speed, lambda x, unit: (headings, speeds + 20 * x * unit)),
    ):
        for index in [(0, 0), (0, 3), (1, 5)]:
            unit = np.zeros((2, 6))
            unit[index] = 1.0
            wanted = differences(lambda x, move=move, unit=unit: move(x, unit))
            assert found[index] == pytest.approx(wanted, abs=1e-6 * np.abs(found).max())


def test_the_eigenvalue_is_exact_at_the_end():
    plan = gm.maneuver.plan(TARGET, START, SPEED, DT, 40, criterion="E", standoff=500.0)
    offset = np.array(TARGET) - plan.path
    rows = offset[:, ::-1] * [1, -1] / (offset**2).sum(axis=1)[:, None]
    assert plan.value == pytest.approx(np.linalg.eigvalsh(rows.T @ rows)[0], rel=1e-9)
    other = gm.maneuver.plan(TARGET, START, SPEED, DT, 40, criterion="D", standoff=500.0)
    offset = np.array(TARGET) - other.path
    rows = offset[:, ::-1] * [1, -1] / (offset**2).sum(axis=1)[:, None]
    assert plan.value >= np.linalg.eigvalsh(rows.T @ rows)[0]


@pytest.mark.parametrize("criterion", ["A", "E", {"combination": "range"}, {"combination": [1, 0]}])
def test_each_criterion_is_better_served_by_its_own_plan(criterion):
    def value(path):
        offset = np.array(TARGET) - path
        rows = offset[:, ::-1] * [1, -1] / (offset**2).sum(axis=1)[:, None]
        bound = np.linalg.inv(rows.T @ rows)
        if criterion == "A":
            return np.trace(bound)
        if criterion == "E":
            return 1 / np.linalg.eigvalsh(rows.T @ rows)[0]
        return bound[0, 0] if criterion["combination"] == [1, 0] else bound[1, 1]

    options = {"standoff": 700.0}
    own = gm.maneuver.plan(TARGET, START, SPEED, DT, 50, criterion=criterion, **options)
    other = gm.maneuver.plan(TARGET, START, SPEED, DT, 50, criterion="D", **options)
    assert value(own.path) <= value(other.path) * (1 + 1e-6)
    assert all(law.behind > 1 for law in own.laws)
    told = 1 / own.value if criterion == "E" else own.value
    assert told == pytest.approx(value(own.path), rel=1e-8)


def test_the_plan_is_the_same_in_a_turned_and_scaled_world():
    base = gm.maneuver.plan(TARGET, START, SPEED, DT, 40, standoff=800.0)
    turned = gm.maneuver.plan([1e6 + 3e3, 0.0], [1e6, 0.0], 60.0, DT, 40, standoff=2400.0)
    # det J falls with the fourth power of the scale.
    assert turned.value + 4 * np.log(3) == pytest.approx(base.value, abs=2e-3)


@pytest.mark.parametrize("legs", [2, 3])
def test_legs_are_straight_and_the_turns_are_found(legs):
    free = gm.maneuver.plan(TARGET, START, SPEED, DT, 40, standoff=500.0)
    plan = gm.maneuver.plan(TARGET, START, SPEED, DT, 40, standoff=500.0, legs=legs)
    assert plan.turns.size == legs - 1
    runs = np.split(np.unwrap(plan.headings), plan.turns)
    assert all(np.ptp(run) < 1e-12 for run in runs)
    assert plan.converged
    assert plan.value < free.value
    assert np.hypot(*(plan.path - TARGET).T).min() >= 500.0 * (1 - 1e-9)


def two_legs(state, sigma, moves):
    task = Task.checked(
        target=state, start=[0, 0], speed=20.0, dt=1.0, samples=moves + 1, criterion="D",
        sigma=sigma, sensors=None, belief=None, over="expectation", standoff=0.0, keep_out=None,
        polygons=None, max_turn_rate=None, heading=None, legs=2, return_to=None,
        max_distance=None, separation=None, current=None, prior=None, weights=None, scale=None,
    )  # fmt: skip
    return _core.PlanSearch(task.problem(), 1, 0, 1, 0)


def turn_of_the_best_grid(state, standoff, sigma, moves=59):
    """The best two-leg path of a grid of headings and turns, without a planner."""
    angles = np.radians(np.arange(-180.0, 180.0, 12.0))
    pairs = np.stack([grid.ravel() for grid in np.meshgrid(angles, angles)], axis=1)
    unit = np.stack([np.sin(pairs), np.cos(pairs)], axis=-1)
    sample = np.arange(1, moves + 1)
    track = np.array(state[:2]) + sample[:, None] * np.array(state[2:])
    best = (-np.inf, 0)
    for turn in range(3, moves - 2, 4):
        ask = two_legs(state, sigma, moves)
        values = np.array(
            [
                ask.judge([turn, moves - turn], [pair.tolist()], [[20.0, 20.0]])["value"]
                for pair in pairs
            ]
        )
        first = np.minimum(sample, turn)
        path = 20 * (
            first[None, :, None] * unit[:, None, 0]
            + (sample - first)[None, :, None] * unit[:, None, 1]
        )
        near = np.hypot(*np.moveaxis(path - track, 2, 0)).min(axis=1) < standoff
        values[near] = -np.inf
        best = max(best, (values.max(), turn))
    return best


@pytest.mark.parametrize("state", [[0.0, 400.0, -5.0, 5.0], [0.0, 400.0, 6.0, -10.0]])
def test_a_moving_target_at_twenty_steps_wants_a_turn_near_mid_track(state):
    sigma = np.radians(0.5)
    options = {"sigma": sigma, "standoff": 320.0}
    plan = gm.maneuver.plan(state, START, SPEED, DT, 60, legs=2, **options)
    assert 59 / 3 <= plan.turns[0] <= 2 * 59 / 3
    grid, _ = turn_of_the_best_grid(state, 320.0, sigma)
    assert plan.value >= grid
    # The heading is lead, then lag: across the line of sight to either side.
    assert np.sin(plan.headings[0]) * np.sin(plan.headings[-1]) < 0
    # A straight leg determines nothing; the bound exists with the turn.
    assert np.isfinite(plan.crlb_std).all()
    with pytest.raises(gm.UnobservableError, match="legs = 1"):
        gm.maneuver.plan(state, START, SPEED, DT, 60, legs=1, **options)


def test_a_far_moving_target_wants_its_turn_at_a_third():
    state, sigma = [0.0, 10_000.0, 8.0, 0.0], np.radians(0.5)
    plan = gm.maneuver.plan(state, START, SPEED, DT, 60, legs=2, sigma=sigma)
    grid, turn = turn_of_the_best_grid(state, 100.0, sigma)
    assert plan.value >= grid
    assert min(abs(plan.turns[0] - turn), abs(59 - plan.turns[0] - turn)) <= 3
    assert min(plan.turns[0], 59 - plan.turns[0]) == pytest.approx(59 / 3, abs=3)


def test_free_headings_are_no_worse_than_legs():
    state, options = [0.0, 10_000.0, 8.0, 0.0], {"sigma": np.radians(0.5)}
    legs = gm.maneuver.plan(state, START, SPEED, DT, 60, legs=3, **options)
    free = gm.maneuver.plan(state, START, SPEED, DT, 60, **options)
    assert free.value >= legs.value


def test_a_single_leg_obeys_its_first_turn():
    plan = gm.maneuver.plan(
        TARGET, START, SPEED, DT, 10, legs=1, heading=1.0, max_turn_rate=0.2, standoff=100.0
    )
    assert plan.converged
    assert np.ptp(plan.headings) == 0
    assert abs(plan.headings[0] - 1.0) <= 0.2 + 1e-9


def test_a_prior_makes_a_straight_leg_enough():
    state = [0.0, 400.0, 0.0, 10.0]
    options = {"sigma": np.radians(0.5), "standoff": 200.0, "legs": 1}
    plan = gm.maneuver.plan(
        state, START, SPEED, DT, 60, prior={"speed": 1.0, "course": 0.1}, **options
    )
    assert np.isfinite(plan.value)
    assert plan.crlb_std[0, 3] < 1.0


def test_several_possible_targets_get_the_expectation():
    targets = [[0.0, 800.0], [0.0, 1000.0], [0.0, 1300.0]]
    weights = [1.0, 2.0, 1.0]
    plan = gm.maneuver.plan(targets, START, SPEED, DT, 40, standoff=500.0, weights=weights)
    total = 0.0
    for target, weight in zip(targets, weights, strict=True):
        offset = np.array(target) - plan.path
        assert np.hypot(*offset.T).min() >= 500.0
        rows = offset[:, ::-1] * [1, -1] / (offset**2).sum(axis=1)[:, None]
        total += weight / 4 * np.linalg.slogdet(rows.T @ rows)[1]
    assert plan.value == pytest.approx(total, rel=1e-9)
    assert plan.crlb_std.shape == (3, 2)


def test_limits_are_kept_together():
    plan = gm.maneuver.plan(
        TARGET, START, SPEED, DT, 60, standoff=500.0, keep_out=[[150.0, 350.0, 120.0]],
        max_turn_rate=np.radians(6.0), heading=0.0,
    )  # fmt: skip
    assert np.hypot(*(plan.path - TARGET).T).min() >= 500.0 * (1 - 1e-9)
    # All of the path is out of the circle, not its samples alone.
    share = np.linspace(0, 1, 50)[:, None, None]
    points = (1 - share) * plan.path[:-1] + share * plan.path[1:]
    assert np.hypot(*np.moveaxis(points - [150.0, 350.0], 2, 0)).min() >= 120.0 * (1 - 1e-9)
    turns = np.diff(np.unwrap(np.concatenate([[0.0], plan.headings])))
    assert np.abs(turns).max() <= np.radians(6.0) + 1e-9
    assert plan.clearance >= -1e-6
    assert plan.converged


def test_a_speed_range_is_used():
    plan = gm.maneuver.plan(TARGET, START, (10.0, 20.0), DT, 30, standoff=500.0)
    fixed = gm.maneuver.plan(TARGET, START, 20.0, DT, 30, standoff=500.0)
    assert plan.speeds.min() >= 10.0 - 1e-9
    assert plan.speeds.max() <= 20.0 + 1e-9
    assert plan.value >= fixed.value - 1e-3


def test_without_a_stand_off_the_path_stays_a_step_away():
    plan = gm.maneuver.plan([0.0, 100.0], START, SPEED, DT, 20)
    assert plan.standoff == 20.0
    assert np.hypot(*(plan.path - [0.0, 100.0]).T).min() >= 20.0 * (1 - 1e-9)


def test_a_plan_that_did_not_converge_says_so_and_is_still_a_path():
    plan = gm.maneuver.plan(
        TARGET, START, SPEED, DT, 60, standoff=500.0, starts=1, restarts=0, max_iterations=1
    )
    assert not plan.converged
    assert "limit" in plan.message.lower()
    assert plan.path.shape == (60, 2)
    assert "NOT CONVERGED" in plan.summary()
    assert np.hypot(*(plan.path - TARGET).T).min() >= 500.0 * (1 - 1e-9)


def test_limits_that_nothing_keeps_are_told():
    # Straight at the circle, with a turn too slow to miss it.
    plan = gm.maneuver.plan(
        TARGET, START, SPEED, DT, 20, keep_out=[[0.0, 60.0, 50.0]], heading=0.0, max_turn_rate=0.05
    )
    assert not plan.converged
    assert "no path found that keeps all limits" in plan.message
    assert plan.clearance < 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"standoff": 1200.0}, "inside standoff = 1200 m"),
        (
            {"keep_out": [[500.0, 0, 50], [10.0, 0.0, 50.0]]},
            r"keep_out\[1\], inside its radius 50 m",
        ),
        ({"keep_out": [[500.0, 0, 0.0]]}, r"keep_out\[0\]: its radius = 0.0"),
        ({"keep_out": [1.0, 2.0]}, "keep_out has shape"),
        ({"speed": 0.0}, "speed = 0.0 m/s: must be > 0"),
        ({"speed": (20.0, 10.0)}, "least must not exceed"),
        ({"speed": np.nan}, "speed = nan: must be finite"),
        ({"dt": 0.0}, "dt = 0.0 s: must be > 0"),
        ({"dt": -1.0}, "dt = -1.0 s: must be > 0"),
        ({"samples": 1}, "samples = 1: must be >= 2"),
        ({"samples": 2.5}, "samples = 2.5"),
        ({"start": [0.0, 1000.0]}, "start is on target"),
        ({"start": [0.0]}, "start has shape"),
        ({"target": [1.0, 2.0, 3.0]}, "target has shape"),
        ({"criterion": "F"}, "criterion = 'F'"),
        ({"criterion": {"combination": "speed"}}, "combination = 'speed': must be one of x, y"),
        ({"criterion": {"combination": [0.0, 0.0]}}, "not all zero"),
        ({"sigma": 0.0}, "sigma = 0.0 rad: must be > 0"),
        ({"max_turn_rate": 0.0}, "max_turn_rate = 0.0 rad/s"),
        ({"legs": 0}, "legs = 0"),
        ({"legs": 40}, "legs = 40"),
        ({"prior": [1.0, 1.0]}, "prior without sigma"),
        ({"prior": [1.0, -1.0], "sigma": 0.1}, r"prior\[1\] = -1.0"),
        ({"prior": {"depth": 1.0}, "sigma": 0.1}, "prior = 'depth'"),
        ({"weights": [1.0, 1.0]}, "weights has shape"),
        ({"weights": [-1.0]}, r"weights\[0\] = -1.0"),
        ({"scale": [1.0, 0.0]}, r"scale\[1\] = 0.0"),
        ({"starts": 0}, "starts = 0"),
    ],
)
def test_bad_input_is_named(change, words):
    given_ = {"target": TARGET, "start": START, "speed": SPEED, "dt": DT, "samples": 40, **change}
    positional = [given_.pop(name) for name in ("target", "start", "speed", "dt", "samples")]
    with pytest.raises(gm.InputError, match=words):
        gm.maneuver.plan(*positional, **given_)


def test_a_towed_array_turns_since_one_leg_leaves_the_mirror():
    # A cone angle is the same for a target and its mirror image about a straight path.
    sigma, target = 0.02, [300.0, 700.0]
    array = [gm.maneuver.Sensing("cone_angle", sigma)]
    plan = gm.maneuver.plan(
        target, START, SPEED, DT, 30, sensors=array, standoff=300.0, legs=2, bound=False
    )
    headings = np.unwrap(plan.headings)
    assert np.ptp(headings) > np.radians(20)

    def angles(place, path, heading):
        offset = np.asarray(place) - path
        relative = np.arctan2(*offset.T) - heading
        return np.arccos(np.cos(relative))

    def mirror(path):
        along = path[-1] - path[0]
        along /= np.hypot(*along)
        offset = np.array(target) - path[0]
        return path[0] + 2 * (offset @ along) * along - offset

    # One leg sees both at the same angles, whatever its heading.
    line = np.arange(30)[:, None] * SPEED * np.array([[np.sin(0.9), np.cos(0.9)]])
    np.testing.assert_allclose(
        angles(target, line, 0.9), angles(mirror(line), line, 0.9), atol=1e-9
    )
    # The planned path tells them apart: the best state there is near the mirror image of
    # either leg is many standard deviations off.
    heading = np.concatenate([plan.headings[:1], plan.headings])
    truth = angles(target, plan.path, heading)
    turn = int(plan.turns[0])
    for part in (slice(0, turn + 1), slice(turn, None)):
        image = mirror(plan.path[part])
        grid = image + np.stack(np.meshgrid(*[np.linspace(-80, 80, 41)] * 2), -1).reshape(-1, 2)
        far = [place for place in grid if np.hypot(*(place - target)) > 100]
        off = [((angles(place, plan.path, heading) - truth) ** 2).sum() for place in far]
        assert min(off) / sigma**2 > 20
