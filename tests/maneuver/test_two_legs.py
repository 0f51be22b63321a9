"""Two legs at long range: the closed form, and the planner against it."""

import numpy as np
import pytest

import gramian as gm

CASE = {"speed": 20.0, "duration": 59.0, "samples": 60, "sigma": np.radians(0.5)}


def flown(range_, turn, cross_speed=0.0, samples=2001, side=1):
    """Log det and bound on the range of two legs across the line of sight, by the rows."""
    t = np.linspace(0.0, 59.0, samples)
    dt, k = t[1], round(turn * (samples - 1))
    east = side * 20.0 * dt * np.where(np.arange(samples - 1) < k, 1.0, -1.0)
    path = np.concatenate([[[0.0, 0.0]], np.cumsum(np.stack([east, 0 * east], 1), axis=0)])
    state = [0.0, range_, cross_speed, 0.0]
    information = gm.maneuver.fisher(path, state, np.radians(0.5), t)
    std = gm.crlb_std(gm.bearings.problem(t, path, state, np.radians(0.5)))
    return np.linalg.slogdet(information)[1], std[1]


@pytest.mark.parametrize("cross_speed", [0.0, 6.0, -11.0])
@pytest.mark.parametrize("turn", [0.25, 0.5, 0.8])
def test_the_closed_form_is_the_information_far_away(cross_speed, turn):
    found = gm.maneuver.two_legs(
        1e6, **(CASE | {"samples": 2001}), cross_speed=cross_speed, turn=turn
    )
    log_det, std = flown(1e6, turn, cross_speed)
    assert found.log_det == pytest.approx(log_det, abs=0.01)
    assert found.range_std == pytest.approx(std, rel=3e-3)


def test_the_best_turn_is_the_root():
    best = gm.maneuver.two_legs(1e5, **CASE)
    y = best.turn * (1 - best.turn)
    assert 10 * y**3 - 5 * y + 1 == pytest.approx(0.0, abs=1e-7)
    late = gm.maneuver.two_legs(1e5, **CASE, turn=1 - best.turn)
    middle = gm.maneuver.two_legs(1e5, **CASE, turn=0.5)
    assert late.log_det == pytest.approx(best.log_det, abs=1e-9)
    assert np.exp(middle.log_det - best.log_det) == pytest.approx(0.904, abs=5e-4)
    assert best.turn_time == pytest.approx(59.0 * best.turn)


@pytest.mark.parametrize("cross_speed", [0.0, -5.0, 6.0])
def test_the_planner_finds_the_closed_form(cross_speed):
    for goal, criterion in (("determinant", "D"), ("range", {"combination": "range"})):
        best = gm.maneuver.two_legs(1e6, **CASE, cross_speed=cross_speed, goal=goal)
        plan = gm.maneuver.plan(
            [0.0, 1e6, cross_speed, 0.0], [0.0, 0.0], 20.0, 1.0, 60,
            sigma=np.radians(0.5), legs=2, criterion=criterion, starts=4,
        )  # fmt: skip
        # The determinant does not change when time runs backwards.
        shares = [best.turn] if goal == "range" else [best.turn, 1 - best.turn]
        # The optimum is flat: two bearings of 59 and a quarter of a radian change little.
        assert min(abs(plan.turns[0] / 59 - share) for share in shares) < 2.0 / 59
        for found, wanted in zip(plan.headings[[0, -1]], best.headings, strict=True):
            assert abs(np.sin(found)) == pytest.approx(abs(np.sin(wanted)), abs=0.1)
        assert plan.headings[0] * plan.headings[-1] < 0
        if goal == "range":
            assert plan.value**0.5 == pytest.approx(best.range_std, rel=0.04)
            assert plan.headings[0] * best.headings[0] > 0 or cross_speed == 0
        else:
            assert plan.value == pytest.approx(best.log_det, abs=0.25)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"range_": 0.0}, "range_ = 0.0 m: must be > 0"),
        ({"speed": -1.0}, "speed = -1.0 m/s: must be > 0"),
        ({"sigma": np.nan}, "sigma"),
        ({"samples": 3}, "samples = 3: must be >= 4"),
        ({"cross_speed": 20.0}, "cross"),
        ({"turn": 1.5}, "turn = 1.5: must be 0 to 1"),
        ({"goal": "speed"}, "goal"),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(gm.InputError, match=message):
        gm.maneuver.two_legs(**({"range_": 1e4} | CASE | change))
