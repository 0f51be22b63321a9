"""Locating a passing dipole: exactness, efficiency, the global minimum, knowledge, refusals."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.dipole import localize, localize_many, localize_trials, measure, simulate

TABLE_1 = ([-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0])
STATE = np.concatenate(TABLE_1)
TIMES = np.arange(21.0)
PAIR = [[0, 0, 0], [0, 0.5, 0]]


def state_of(answer):
    return np.concatenate([answer.r0, answer.v, answer.m])


def relative_error(found, true):
    """Of position, velocity and moment, each on its own scale."""
    return max(
        np.linalg.norm((found - true)[part]) / np.linalg.norm(true[part])
        for part in (slice(0, 3), slice(3, 6), slice(6, 9))
    )


def random_passes(count, seed):
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        r0, v, m = rng.normal(size=3) * 10, rng.normal(size=3), rng.normal(size=3) * 30
        if np.linalg.norm(r0 + TIMES[:, None] * v, axis=1).min() > 1:
            found.append((r0, v, m))
    return found


def test_exact_data_of_table_1_from_its_own_starts():
    answer = localize(TIMES, measure(*TABLE_1, TIMES), {"z": 5.0, "vz": 0.0})
    assert relative_error(state_of(answer), STATE) < 1e-8
    assert answer.mirror is None, "z known to be 5 excludes it"
    assert answer.converged


@pytest.mark.parametrize("seed", [0, 1])
def test_the_global_minimum_of_random_passes_with_known_speed(seed):
    passes = random_passes(200, seed)
    hits = 0
    for r0, v, m in passes:
        answer = localize_many(TIMES, measure(r0, v, m, TIMES), {"speed": np.linalg.norm(v)})
        true = np.concatenate([r0, v, m])
        hits += min(relative_error(x, true) for x in (answer.states, answer.mirrors)) < 1e-5
    assert hits >= 198


def test_the_global_minimum_under_noise():
    worse = 0
    for i, (r0, v, m) in enumerate(random_passes(200, 3)):
        y = simulate(r0, v, m, TIMES, 1e-9, seed=i)
        answer = localize_many(TIMES, y, {"speed": np.linalg.norm(v)}, sigma=1e-9)
        # The least squares of the true pass bound those of the best from above.
        at_truth = ((y - measure(r0, v, m, TIMES)) ** 2).sum() / 1e-18
        worse += answer.costs > at_truth
    assert worse <= 2


def test_it_reaches_the_bound_at_1_nt():
    found = localize_trials(
        *TABLE_1, TIMES, 1e-9, seed=11, trials=1000, known={"z": 5.0, "vz": 0.0}
    )
    bound = gm.crlb_std(gm.dipole.problem(*TABLE_1, TIMES, 1e-9).fix("z0", "vz"))
    free = [0, 1, 3, 4, 6, 7, 8]
    ratio = np.sqrt(((found - STATE)[:, free] ** 2).mean(axis=0)) / bound
    assert abs(ratio - 1).max() < 0.07


def test_trials_do_not_depend_on_how_they_are_cut_and_are_those_of_simulate():
    known = {"z": 5.0, "vz": 0.0}
    whole = localize_trials(*TABLE_1, TIMES, 1e-9, 5, 12, known=known)
    parts = [localize_trials(*TABLE_1, TIMES, 1e-9, 5, 4, known=known, first=i) for i in (0, 4, 8)]
    np.testing.assert_array_equal(whole, np.concatenate(parts))
    before = gm.set_threads(1)
    try:
        np.testing.assert_array_equal(
            whole, localize_trials(*TABLE_1, TIMES, 1e-9, 5, 12, known=known)
        )
    finally:
        gm.set_threads(before)
    y = simulate(*TABLE_1, TIMES, 1e-9, 5, trials=12)
    np.testing.assert_array_equal(whole, localize_many(TIMES, y, known, sigma=1e-9).states)


@pytest.mark.parametrize(
    "known",
    [
        {"speed": np.sqrt(2)},
        {"moment": np.sqrt(600)},
        {"vx": 1.0},
        {"mx": 10.0},
        {"y": -10.0},
        {"x": -10.0, "speed": np.sqrt(2)},
        {"z": 5.0, "moment": np.sqrt(600)},
        {"mx": 10.0, "my": 20.0, "mz": 10.0},
        {"vx": 1.0, "vy": 1.0, "vz": 0.0},
        {"vx": 1.0, "speed": np.sqrt(2)},
        {"mx": 10.0, "moment": np.sqrt(600)},
        dict(zip(gm.dipole.NAMES[:6], STATE[:6], strict=True)),
        dict(zip(gm.dipole.NAMES, STATE, strict=True)),
    ],
    ids=" ".join,
)
def test_every_kind_of_knowledge(known):
    answer = localize(TIMES, measure(*TABLE_1, TIMES), known, sigma=1e-9)
    found = [state_of(answer)]
    if answer.mirror is not None:
        found.append(np.concatenate([answer.mirror.r0, answer.mirror.v, answer.mirror.m]))
    assert min(relative_error(x, STATE) for x in found) < 1e-6
    # The bound is that of the problem with the knowledge as constraints.
    problem = gm.dipole.problem(*TABLE_1, TIMES, 1e-9)
    states = [name if len(name) > 1 else f"{name}0" for name in known]
    fixed = [name for name in states if name in gm.dipole.NAMES]
    sizes = [name for name in states if name not in gm.dipole.NAMES]
    if len(fixed) < 9 and len(sizes) <= 1 and found[0] @ STATE > 0:
        left = problem.fix(*fixed) if fixed else problem
        bound = gm.analyze(left).knowing(sizes[0]).crlb_std if sizes else gm.crlb_std(left)
        kept = [i for i, name in enumerate(gm.dipole.NAMES) if name not in fixed]
        if relative_error(found[0], STATE) < 1e-6:
            np.testing.assert_allclose(answer.pass_std[kept], bound, rtol=1e-4, atol=1e-12)
    assert (answer.pass_std[[gm.dipole.NAMES.index(name) for name in fixed]] == 0).all()


def test_both_mirror_images_are_given_with_their_cost():
    y = measure(*TABLE_1, TIMES)
    answer = localize(TIMES, y, {"speed": np.sqrt(2)}, sigma=1e-9)
    np.testing.assert_allclose(answer.mirror.r0, -answer.r0, atol=1e-6)
    np.testing.assert_allclose(answer.mirror.v, -answer.v, atol=1e-6)
    np.testing.assert_allclose(answer.mirror.m, answer.m, atol=1e-5)
    assert "either may be true" in answer.summary()
    # A prior tells the two apart.
    told = localize(TIMES, y, {"speed": np.sqrt(2)}, prior={"vx": (1.0, 0.5)}, sigma=1e-9)
    np.testing.assert_allclose(state_of(told), STATE, rtol=1e-4, atol=1e-3)
    assert told.mirror.cost > told.cost + 1


def test_priors_weigh_as_in_the_bound():
    y = measure(*TABLE_1, TIMES)
    prior = {"speed": (np.sqrt(2), 0.01), "vx": (1.0, 0.3)}
    answer = localize(TIMES, y, prior=prior, sigma=1e-9)
    np.testing.assert_allclose(state_of(answer), STATE, rtol=1e-4, atol=1e-3)
    problem = gm.dipole.problem(*TABLE_1, TIMES, 1e-9).prior({"speed": 0.01, "vx": 0.3})
    np.testing.assert_allclose(answer.pass_std, gm.crlb_std(problem), rtol=1e-3)


def test_two_sensors_need_no_knowledge():
    y = measure(*TABLE_1, TIMES, sensors=PAIR)
    answer = localize(TIMES, y, sensors=PAIR)
    assert relative_error(state_of(answer), STATE) < 1e-6
    assert answer.mirror is None or answer.mirror.cost > 1e6 * answer.cost


def test_background_is_removed_by_median_and_by_fit():
    # The median wants a record that is mostly quiet.
    times = np.arange(-150.0, 150.0)
    r0 = np.array([-100.0, -100.0, 5.0]) - 50 * np.array([1.0, 1.0, 0.0])
    background = np.array([2e-5, -1e-6, 4.5e-5])
    y = measure(r0, TABLE_1[1], TABLE_1[2], times) + background
    fitted = localize(times, y, {"z": 5.0}, background="fit")
    np.testing.assert_allclose(fitted.background[0], background, rtol=1e-9)
    np.testing.assert_allclose(fitted.m, TABLE_1[2], rtol=1e-5)
    median = localize(times, y, {"z": 5.0}, background="median")
    np.testing.assert_allclose(median.m, TABLE_1[2], rtol=0.07)
    # The bound pays for the constants.
    assert (fitted.pass_std[[0, 1]] / fitted.sigma > 0).all()


def test_spikes_do_not_matter_under_the_robust_loss():
    times = np.arange(0, 20, 0.1)
    rng = np.random.default_rng(4)
    y = simulate(*TABLE_1, times, 1e-9, seed=3)
    clean = localize(times, y, {"z": 5.0, "vz": 0.0}, sigma=1e-9)
    hit = rng.choice(times.size, 8, replace=False)
    y[hit] += rng.normal(size=(8, 3)) * 2e-3
    answer = localize(times, y, {"z": 5.0, "vz": 0.0}, loss="huber", sigma=1e-9)
    assert answer.spikes == 8
    assert (answer.weights[hit] == 0).all()
    assert (
        abs(
            (state_of(answer) - state_of(clean)) / np.where(clean.pass_std > 0, clean.pass_std, 1)
        ).max()
        < 1
    )


def test_sigma_is_estimated():
    y = simulate(*TABLE_1, np.arange(0, 20, 0.1), 3e-9, seed=8)
    answer = localize(np.arange(0, 20, 0.1), y, {"z": 5.0, "vz": 0.0})
    assert answer.sigma == pytest.approx(3e-9, rel=0.1)


def test_a_window_keeps_the_instant_of_the_state():
    y = measure(*TABLE_1, TIMES)
    answer = localize(TIMES, y, {"z": 5.0, "vz": 0.0}, window=(6.0, 16.0), sigma=1e-9)
    assert answer.times[0] == 6.0
    np.testing.assert_allclose(state_of(answer), STATE, rtol=1e-6, atol=1e-7)
    # All samples bound better than some.
    whole = localize(TIMES, y, {"z": 5.0, "vz": 0.0}, sigma=1e-9)
    assert (answer.pass_std[[0, 1, 3, 4]] > whole.pass_std[[0, 1, 3, 4]]).all()


@pytest.mark.parametrize(
    ("known", "repairs"),
    [(None, "speed"), ({"vz": 0.0}, "speed"), ({"vx": 0.0}, None)],
)
def test_knowledge_that_does_not_suffice_is_refused(known, repairs):
    with pytest.raises(gm.UnobservableError, match="does not suffice") as error:
        localize(TIMES, measure(*TABLE_1, TIMES), known)
    assert len(error.value.null_combinations) == 1
    if repairs:
        assert repairs in str(error.value)
    text = error.value.null_combinations[0]
    assert all(name in text for name in ("x0", "y0", "z0", "mx", "my", "mz"))


def test_known_zero_of_a_flat_pass_is_refused():
    y = measure([-10, -8, 0], [1, 0.9, 0.1], [10, 20, 10], TIMES)
    with pytest.raises(gm.UnobservableError):
        localize(TIMES, y, {"z": 0.0})


@pytest.mark.parametrize(
    ("known", "prior", "message"),
    [
        ({"speed": 1.0, "vx": 2.0}, None, "known speed = 1 m/s contradicts"),
        ({"moment": 5.0, "mx": 3.0, "my": 3.0, "mz": 3.0}, None, "known moment = 5 A m"),
        ({"z": 5.0}, {"z0": (4.0, 1.0)}, "z0 is known exactly and has a prior"),
        ({"speed": -1.0}, None, r"speed = -1\.0: must be > 0"),
        ({"depth": 5.0}, None, "'depth' cannot be known"),
        ({"z": np.nan}, None, "must be finite"),
        ({"z": 5.0}, {"speed": 3.0}, r"prior of speed = 3\.0: must be \(mean, sigma\)"),
        ({"z": 5.0}, {"speed": (3.0, 0.0)}, "must have sigma > 0"),
    ],
)
def test_contradictory_or_senseless_knowledge(known, prior, message):
    with pytest.raises(gm.InputError, match=message):
        localize(TIMES, measure(*TABLE_1, TIMES), known, prior=prior)


def test_missing_samples_are_dropped_only_if_asked_and_counted():
    y = measure(*TABLE_1, TIMES)
    y[[3, 7], 1] = np.nan
    with pytest.raises(
        gm.InputError, match="2 of 21 samples are not finite, the first is sample 3"
    ):
        localize(TIMES, y, {"z": 5.0})
    answer = localize(TIMES, y, {"z": 5.0}, missing="drop")
    assert answer.dropped == 2
    assert relative_error(state_of(answer), STATE) < 1e-6
    first = measure(*TABLE_1, TIMES)
    first[0] = np.nan
    # The state stays that of the first time.
    answer = localize(TIMES, first, {"z": 5.0}, missing="drop")
    assert relative_error(state_of(answer), STATE) < 1e-6


def test_other_bad_input():
    y = measure(*TABLE_1, TIMES)
    with pytest.raises(gm.InputError, match="2 samples give 6 numbers for 8 unknowns"):
        localize(TIMES[:2], y[:2], {"z": 5.0})
    with pytest.raises(gm.InputError, match="there is no pass in it"):
        localize(TIMES, np.zeros((21, 3)), {"z": 5.0})
    with pytest.raises(gm.InputError, match="must be later"):
        localize(TIMES[::-1], y, {"z": 5.0})
    with pytest.raises(gm.InputError, match=r"times\[20\] = 1e\+308 s: must be at most"):
        localize(np.r_[TIMES[:-1], 1e308], y, {"z": 5.0})
    with pytest.raises(gm.InputError, match="starts = 100000: must be <= 1000"):
        localize(TIMES, y, {"z": 5.0}, starts=10**5)
    with pytest.raises(gm.InputError, match=r"field has shape \(21, 2\)"):
        localize(TIMES, y[:, :2], {"z": 5.0})
    with pytest.warns(UserWarning, match="must be in tesla"):
        localize(TIMES, y * 1e9 + 2, {"z": 5.0}, background="median")


def test_the_answer_is_plain_and_readable():
    answer = localize(TIMES, simulate(*TABLE_1, TIMES, 1e-9, 1), {"z": 5.0, "vz": 0.0}, sigma=1e-9)
    data = answer.to_dict()
    assert data["pass_std"][2] == 0
    assert data["closest"]["range"] == pytest.approx(5, abs=0.2)
    assert "closest at" in answer.summary()
    assert "excluded by what is known" in answer.summary()
    assert answer.speed[0] == pytest.approx(np.sqrt(2), rel=0.1)


def test_special_passes_are_refused_with_all_their_null_combinations():
    r0, m = np.array([-10.0, -4.0, 3.0]), [10.0, 20.0, 10.0]
    v = -r0 / 4.7
    with pytest.raises(gm.UnobservableError) as error:
        localize(TIMES, measure(r0, v, m, TIMES), {"speed": np.linalg.norm(v)})
    assert len(error.value.null_combinations) == 2, "radial: turns about the line of sight"
    v = np.array([1.0, 0.5, 0.2])
    with pytest.raises(gm.UnobservableError) as error:
        localize(TIMES, measure(r0, v, np.cross(r0, v), TIMES), {"speed": np.linalg.norm(v)})
    assert len(error.value.null_combinations) == 1, "the moment across the plane of the pass"


def test_a_weak_answer_says_so():
    r0 = np.array([-10.0, -4.0, 3.0])
    y = simulate(r0, -r0 / 4.7, [10.0, 20.0, 10.0], TIMES, 1e-9, seed=2)
    answer = localize(TIMES, y, {"speed": np.linalg.norm(r0 / 4.7)}, sigma=1e-9)
    # Radial: its mirror image fits as well, and the range may be nothing.
    assert answer.status == "ambiguous"
    assert answer.summary().startswith("AMBIGUOUS: ")
    assert answer.closest.range_std > answer["range"]
    noise = np.random.default_rng(0).normal(size=(21, 3)) * 1e-9
    assert localize(TIMES, noise, {"speed": 1.0, "z": 5.0}).status == "weak"


def test_a_constant_field_over_a_background_holds_no_pass():
    y = np.broadcast_to(measure([5, 1, 2], [0, 0, 0], [1, 2, 3], [0.0]), (21, 3))
    for background in ("fit", "median"):
        with pytest.raises(gm.InputError, match="field is constant"):
            localize(TIMES, y, {"z": 2.0}, background=background)


@pytest.mark.parametrize(
    "known_of",
    [
        lambda r0, v, m: {"z": r0[2]},
        lambda r0, v, m: {"moment": np.linalg.norm(m)},
        lambda r0, v, m: {"mx": m[0], "my": m[1], "mz": m[2]},
        lambda r0, v, m: {"vx": v[0], "vy": v[1], "vz": v[2]},
    ],
    ids=["z", "moment", "m", "v"],
)
def test_the_global_minimum_with_other_knowledge(known_of):
    for i, (r0, v, m) in enumerate(random_passes(50, 9)):
        y = simulate(r0, v, m, TIMES, 1e-9, seed=i)
        answer = localize_many(TIMES, y, known_of(r0, v, m), sigma=1e-9)
        assert answer.costs <= ((y - measure(r0, v, m, TIMES)) ** 2).sum() / 1e-18 * (1 + 1e-9)


def test_times_beyond_float64_are_refused_by_many_too():
    """A last time of 1e308 s did not return."""
    times = np.append(np.arange(0.0, 20.0, 0.5), 1e308)
    field = np.ones((2, times.size, 3))
    for call in (
        lambda: gm.dipole.localize_many(times, field, {"vz": 0.0}, sigma=1e-9),
        lambda: gm.dipole.localize(times, field[0], {"vz": 0.0}, sigma=1e-9),
        lambda: gm.dipole.localize_trials(
            [-10.0, -10, 5], [1.0, 1, 0], [10.0, 20, 10], times, sigma=1e-9, known={"vz": 0.0},
            trials=2, seed=1,
        ),
    ):  # fmt: skip
        with pytest.raises(gm.InputError, match=r"times\[40\] = 1e\+308 s: must be at most"):
            call()


def test_times_whose_steps_are_lost_in_them_do_not_hang():
    """Nanoseconds of an epoch: half a step is no larger than their rounding."""
    field = 1e-9 * np.random.default_rng(0).normal(size=(2, 40, 3))
    for times in (1e17 + 16.0 * np.arange(40), 5e-324 * np.arange(40)):
        gm.dipole.localize_many(times, field, {"vz": 0.0}, sigma=1e-9)


def test_deviations_with_an_estimated_noise_are_those_of_students_t():
    t, known = np.linspace(0.0, 20.0, 7), {"z": 5.0, "vz": 0.0}
    y = simulate(*TABLE_1, t, 1e-9, 3, trials=1)[0]
    free = localize(t, y, known)
    given = localize(t, y, known, sigma=free.sigma)
    assert free.freedom == 21 - 7
    assert given.freedom == np.inf
    growth = np.sqrt(14 / 12)
    wanted = [
        (free.pass_std, growth * given.pass_std),
        (free.std, growth * given.std),
        (free.closest.range_std, growth * given.closest.range_std),
        (free.closest.time_std, growth * given.closest.time_std),
    ]
    for found, expected in wanted:
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_prior_is_not_widened_by_an_estimated_noise():
    t, known, prior = np.linspace(0.0, 20.0, 7), {"vz": 0.0}, {"z": (5.0, 1e-3)}
    y = simulate(*TABLE_1, t, 1e-9, 3, trials=1)[0]
    free = localize(t, y, known, prior=prior)
    given = localize(t, y, known, prior=prior, sigma=free.sigma)
    z = free.names.index("z0")
    # The field says nothing of the size of the pass: z is what the prior says.
    assert given.std[z] == pytest.approx(1e-3, rel=1e-9)
    assert free.std[z] == pytest.approx(1e-3, rel=1e-9)
    assert np.all(free.std >= given.std * (1 - 1e-9))
    assert free.std[free.names.index("mx")] > 1.05 * given.std[free.names.index("mx")]
