"""Gradiometers and sensors of the total field."""

from contextlib import suppress

import numpy as np
import pytest

import gramian as gm

R0, V, M = np.array([-10.0, -9.0, 5.0]), np.array([1.0, 0.8, 0.1]), np.array([10.0, 20.0, -10.0])
T = np.arange(0.0, 21.0, 0.5)
EARTH = [2e-5, 1e-6, 4.5e-5]
#: A few times the dipole's own field, so that the size of the sum is far from linear.
NEAR = [3e-8, -2e-8, 9e-8]
ARRAY = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 1.0], [0.0, 5.0, 2.0]])
BASELINE = [0.0, 0.0, 3.0]
BESIDE = np.array([2.0, 1.0, 0.5])
KINDS = {
    "gradiometer": {"baselines": BASELINE},
    "gradiometers": {
        "sensors": ARRAY,
        "baselines": [[0.0, 0.0, 3.0], [2.0, 0.0, 0.0], [0.0, 2.0, 1.0]],
    },
    "total field": {"sensors": ARRAY, "ambient": NEAR},
    "total field, weak": {"sensors": ARRAY, "ambient": EARTH},
    "total gradiometers": {
        "sensors": ARRAY,
        "ambient": [3e-7, -2e-7, 9e-7],
        "baselines": BASELINE,
    },
}


def total(kind):
    return "ambient" in KINDS[kind]


@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_the_derivatives_of_what_is_measured(kind):
    state = np.concatenate([R0, V, M])

    def measured(x):
        return gm.dipole.measure(x[:3], x[3:6], x[6:], T, **KINDS[kind]).ravel()

    rows = gm.dipole.rows(R0, V, M, T, 1e-9, **KINDS[kind])
    # The digits that the ambient field leaves of a difference.
    limit = 1e-8 if KINDS[kind].get("ambient") != EARTH else 1e-4
    for j in range(9):
        slopes = []
        # A velocity moves the last sample by twenty times as much.
        first = 3e-4 if 3 <= j < 6 else 6e-3
        for step in first * np.array([1, 2, 4]):
            up, down = state.copy(), state.copy()
            up[j] += step
            down[j] -= step
            slopes.append((measured(up) - measured(down)) / (2 * step) / 1e-9)
        a, b, c = slopes
        wanted = (16 * (4 * a - b) / 3 - (4 * b - c) / 3) / 15
        np.testing.assert_allclose(rows[:, j], wanted, atol=limit * abs(rows[:, j]).max())


def test_a_gradiometer_measures_the_difference_of_two_sensors():
    first = gm.dipole.measure(R0, V, M, T)
    second = gm.dipole.measure(R0 - BASELINE, V, M, T)
    got = gm.dipole.measure(R0, V, M, T, baselines=BASELINE)
    np.testing.assert_allclose(got, second - first, rtol=0, atol=1e-22)
    size = gm.dipole.measure(R0, V, M, T, ambient=EARTH, baselines=[BASELINE], sensors=[[0, 0, 0]])
    assert size.shape == (len(T), 1)


@pytest.mark.parametrize("kind", KINDS)
def test_the_pass_is_found_and_judged_as_by_three_axes(kind):
    sigma = 1e-13
    y = gm.dipole.simulate(R0, V, M, T, sigma, 3, **KINDS[kind])
    found = gm.dipole.localize(T, y, sigma=sigma, **KINDS[kind])
    assert found.status in ("determined", "ambiguous"), found.reason
    truth = np.concatenate([R0, V, M])
    image = found.mirror
    passes = [np.concatenate([found.r0, found.v, found.m])]
    if image is not None:
        passes.append(np.concatenate([image.r0, image.v, image.m]))
    bound = gm.analyze(gm.dipole.problem(R0, V, M, T, sigma, **KINDS[kind])).crlb_std
    off = min(abs((x - truth) / bound).max() for x in passes)
    assert off < 4.5
    np.testing.assert_allclose(found.pass_std, bound, rtol=0.2)
    assert found.explained > 0.99
    assert found.residuals.shape == (len(T), len(found.sensors), 1 if total(kind) else 3)
    # All that is asked of an estimate.
    low, high = found.interval("range").pieces[0]
    assert low < found.closest.range < high
    np.testing.assert_allclose(
        found.model.h(found.state).reshape(y.shape), y, rtol=0, atol=6 * sigma
    )
    assert found.fit.dof == y.size - 9


@pytest.mark.parametrize("kind", ["gradiometers", "total field"])
def test_intervals_hold_the_truth_and_errors_meet_the_bound(kind):
    trials, sigma = 300, 2e-12
    args = (R0, V, M, T, sigma)
    found = gm.dipole.localize_trials(*args, 1, trials, **KINDS[kind])
    errors = found - np.concatenate([R0, V, M])
    rows = gm.dipole.rows(*args, **KINDS[kind])
    nees = ((rows @ errors.T) ** 2).sum(axis=0)
    # Three deviations of the mean of chi-square of nine.
    assert abs(nees.mean() / 9 - 1) < 3 * np.sqrt(2 / 9 / trials)
    y = gm.dipole.simulate(*args, 5, trials=40, **KINDS[kind])
    held = 0
    for one in y:
        answer = gm.dipole.localize(T, one, sigma=sigma, **KINDS[kind])
        low, high = answer.interval("speed").pieces[0]
        held += low < np.linalg.norm(V) < high
    assert held >= 34, "95 % of 40, less three deviations"


@pytest.mark.parametrize("kind", ["gradiometers", "total field"])
def test_a_constant_and_spikes_and_an_unknown_deviation(kind):
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, **KINDS[kind])
    y[7] += 1e-6
    y += 1e-8
    found = gm.dipole.localize(T, y, background="fit", loss="huber", **KINDS[kind])
    assert abs(found.r0 - R0).max() < 0.1
    assert found.spikes >= len(found.sensors)
    assert 0.5e-12 < found.sigma < 2e-12
    np.testing.assert_allclose(found.background, 1e-8, atol=3e-12)
    assert found["background F of sensor 1" if total(kind) else "background x of sensor 1"]


def test_many_are_each():
    kind = KINDS["total field"]
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, trials=3, **kind)
    many = gm.dipole.localize_many(T, y, sigma=1e-12, **kind)
    one = gm.dipole.localize(T, y[1], sigma=1e-12, **kind)
    np.testing.assert_array_equal(many.states[1], np.concatenate([one.r0, one.v, one.m]))
    assert many.states.shape == (3, 9)


def test_one_sensor_of_the_total_field_says_what_it_cannot_tell():
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, ambient=NEAR)
    with pytest.raises(gm.UnobservableError, match="is not determined") as refused:
        gm.dipole.localize(T, y, sigma=1e-12, ambient=NEAR)
    assert len(refused.value.null_combinations) == 2, "the size, a turn about the ambient field"
    problem = gm.dipole.problem(R0, V, M, T, 1e-12, ambient=NEAR)
    answer = gm.analyze(problem)
    turn = np.concatenate([np.cross(NEAR, x) for x in (R0, V, M)])
    for null in (turn, np.concatenate([R0, V, 3 * M])):
        rest = null - answer.null_space @ np.linalg.lstsq(answer.null_space, null)[0]
        assert np.linalg.norm(rest) < 1e-6 * np.linalg.norm(null)


def test_one_sensor_of_the_total_field_tells_what_fits_as_well():
    # Far weaker than the ambient field: a time, a duration and three sizes, so that four numbers
    # must be known; the pass on the other side of the track has another moment.
    known = {"vx": 1.0, "vy": 0.8, "vz": 0.1, "z": 5.0}
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, ambient=EARTH)
    problem = gm.dipole.problem(R0, V, M, T, 1e-12, ambient=EARTH)
    spectrum = gm.analyze(problem).singular_values
    assert spectrum[4] > 1e4 * spectrum[5]
    found = gm.dipole.localize(T, y, known, sigma=1e-12, ambient=EARTH)
    assert found.status == "ambiguous", found.reason
    passes = [found.model.expand(x)[0] for x in (found.state, *(o.state for o in found.others))]
    bound = gm.crlb_std(problem.fix("vx", "vy", "vz", "z0"))
    free = [0, 1, 6, 7, 8]
    truth = np.concatenate([R0, V, M])
    assert min(abs((x - truth)[free] / bound).max() for x in passes) < 4.5
    assert len(passes) == 2
    for x in passes:
        exact = gm.dipole.measure(x[:3], x[3:6], x[6:], T, ambient=EARTH)
        assert abs(exact - y).max() < 6e-12
    # Less is known: the answer never passes for one that is determined.
    for less in ({"z": 5.0, "speed": float(np.linalg.norm(V))}, {"vx": 1.0, "vy": 0.8, "vz": 0.1}):
        vague = gm.dipole.localize(T, y, less, sigma=1e-12, ambient=EARTH)
        assert vague.status != "determined"
    # A moment and a height rate that are known leave the images about the ambient field.
    told = dict(zip(("mx", "my", "mz"), M.tolist(), strict=True)) | {"vz": 0.1}
    found = gm.dipole.localize(T, y, told, sigma=1e-12, ambient=EARTH)
    assert found.status == "ambiguous"
    every = [found.model.expand(x)[0] for x in (found.state, *(o.state for o in found.others))]
    assert min(abs(x - truth)[:6].max() for x in every) < 0.05


def test_the_mirror_image_at_one_gradiometer_is_about_its_middle():
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, baselines=BASELINE)
    found = gm.dipole.localize(T, y, sigma=1e-12, baselines=BASELINE)
    assert found.status == "ambiguous"
    np.testing.assert_allclose(found.mirror.r0, BASELINE - found.r0, atol=1e-5)
    np.testing.assert_allclose(found.mirror.m, -found.m, atol=1e-4)
    assert "middle of the gradiometer" in found.summary()
    told = gm.dipole.localize(T, y, {"mx": 10.0}, sigma=1e-12, baselines=BASELINE)
    assert told.status == "determined", told.reason
    assert abs(told.r0 - R0).max() < 0.2


def test_a_second_dipole_and_a_stuck_channel_show():
    kind = KINDS["total field"]
    y = gm.dipole.simulate(R0, V, M, T, 1e-13, 3, **kind)
    y += gm.dipole.measure(R0 + BESIDE, V, 0.5 * M, T, **kind) - np.linalg.norm(NEAR)
    assert gm.dipole.localize(T, y, sigma=1e-13, **kind).status == "misfit"
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, **kind)
    y[:, 1] = y[0, 1]
    found = gm.dipole.localize(T, y, sigma=1e-12, **kind)
    assert found.status == "misfit"
    assert "channel F of sensor 2" in found.reason
    used = gm.dipole.localize(T, y, {"z": 5.0}, sigma=1e-12, use=[True, False, True], **kind)
    assert abs(used.r0 - R0).max() < 0.5


def test_pictures_and_saving(tmp_path):
    kind = KINDS["total field"]
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, **kind)
    found = gm.dipole.localize(T, y, sigma=1e-12, **kind)
    assert len(found.plot("field").axes) == 3
    found.save(tmp_path / "found.json")
    again = gm.load(tmp_path / "found.json")
    assert again.model.ambient == tuple(NEAR)
    np.testing.assert_array_equal(again.state, found.state)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ambient": [0.0, 0.0, 0.0]}, "must be three finite numbers in tesla, not all 0"),
        ({"ambient": [1e-5, 2e-5]}, "must be three finite numbers"),
        ({"baselines": [0.0, 0.0, 0.0]}, r"baselines\[0\] is 0"),
        ({"baselines": [[0.0, 0.0, 1.0]] * 2}, r"baselines has shape \(2, 3\): must be \(3,\) or"),
        ({"baselines": [0.0, np.nan, 1.0]}, "baselines"),
        ({"ambient": EARTH}, r"field has shape \(42, 3\) for 42 times: must be \(K,\)"),
        ({"ambient": EARTH, "attitude": 0.1}, "sensors of three components"),
    ],
)
def test_bad_input_is_told(options, message):
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3)
    with pytest.raises(gm.InputError, match=message):
        gm.dipole.localize(T, y, {"z": 5.0}, sigma=1e-12, **options)


def test_bad_input_of_the_others_is_told():
    with pytest.raises(gm.InputError, match=r"baselines has shape \(2,\)"):
        gm.dipole.rows(R0, V, M, T, 1e-9, baselines=[1.0, 2.0])
    with pytest.raises(gm.InputError, match="on the sensor"):
        gm.dipole.measure([0.0, 0.0, 3.0], V, M, [0.0], baselines=BASELINE)
    with pytest.raises(gm.InputError, match=r"field has shape \(4,\): must be \(..., K, 3\)"):
        gm.dipole.localize_many(np.arange(4.0), np.zeros(4), baselines=BASELINE)


def test_an_ambient_field_in_other_units_is_warned_of():
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, sensors=ARRAY, ambient=EARTH)
    # Where it is fitted, far away, the readings may not determine it.
    with (
        pytest.warns(UserWarning, match=r"ambient reaches .* T: it must be in tesla"),
        suppress(gm.UnobservableError),
    ):
        gm.dipole.localize(T, y, sensors=ARRAY, ambient=1e9 * np.array(EARTH), sigma=1e-12)


def turned_half_way():
    half = len(T) // 2
    after = np.maximum(T - T[half], 0.0)[:, None] * [0.0, -1.6 * V[1], 0.0]
    path = R0 + T[:, None] * V + after
    return np.array([gm.dipole.measure(r, 0 * V, M, [0.0], **TOTAL)[0] for r in path])


def with_a_second_dipole():
    second = gm.dipole.measure(R0 - [4.0, 0.0, 0.0], V, [5.0, -10.0, 8.0], T, **TOTAL)
    return EXACT + second - np.linalg.norm(EARTH)


def stuck():
    y = EXACT.copy()
    y[:, 1] = y[0, 1]
    return y


def copied():
    y = EXACT.copy()
    y[:, 2] = y[:, 0]
    return y


TOTAL = {"sensors": ARRAY, "ambient": EARTH}
EXACT = gm.dipole.measure(R0, V, M, T, **TOTAL)
#: 10 degrees about y.
TURNED = [EARTH[0] + 0.17 * EARTH[2], EARTH[1], EARTH[2] - 0.17 * EARTH[0]]


@pytest.mark.parametrize(
    ("record", "options"),
    [
        (turned_half_way(), {}),
        (with_a_second_dipole(), {}),
        (stuck(), {"background": "fit"}),
        (copied(), {"background": "fit"}),
        (EXACT, {"ambient": TURNED, "background": "fit"}),
        (EXACT + 1e-9, {}),
    ],
    ids=["turn", "second dipole", "dead", "copy", "ambient turned", "background"],
)
def test_what_the_total_field_model_does_not_describe_is_a_misfit(record, options):
    y = record + 1e-11 * np.random.default_rng(4).normal(size=record.shape)
    found = gm.dipole.localize(T, y, sigma=1e-11, **(TOTAL | options))
    assert found.status == "misfit", found.reason


def test_a_gradiometer_of_the_total_field_keeps_the_digits_of_a_weak_dipole():
    weak = 1e-9 * M
    got = gm.dipole.measure(R0, V, weak, T, ambient=EARTH, baselines=BASELINE)
    parts = gm.dipole.measure(R0, V, weak, T, baselines=BASELINE)
    along = parts @ EARTH / np.linalg.norm(EARTH)
    np.testing.assert_allclose(got, along, rtol=1e-9, atol=1e-12 * abs(along).max())


#: One deviation of each channel; a quarter of the numbers has another than its neighbours.
def deviations(kind):
    shape = gm.dipole.measure(R0, V, M, T, **({"sensors": [[0, 0, 0]]} | KINDS[kind])).shape
    shape = shape if not total(kind) else (*shape, 1)
    channels = 1e-12 * np.linspace(1.0, 4.0, shape[1] * shape[2]).reshape(shape[1:])
    return channels, channels * np.where(np.arange(len(T)) % 4, 1.0, 7.0)[:, None, None]


@pytest.mark.parametrize("kind", KINDS)
def test_rows_of_each_channel_are_those_weighted_by_hand(kind):
    channels, numbers = deviations(kind)
    plain = gm.dipole.rows(R0, V, M, T, 1.0, **KINDS[kind])
    for sigma in (channels, numbers):
        wanted = plain / np.broadcast_to(sigma, numbers.shape).reshape(-1, 1)
        rows = gm.dipole.rows(R0, V, M, T, sigma, **KINDS[kind])
        np.testing.assert_allclose(rows, wanted, rtol=1e-15)
        bound = gm.crlb_std(gm.dipole.problem(R0, V, M, T, sigma, **KINDS[kind]))
        np.testing.assert_allclose(bound, gm.crlb_std(wanted), rtol=1e-6)
    # Of batches as of one.
    twice = gm.dipole.rows([R0, R0], V, M, T, np.stack([numbers, 2 * numbers]), **KINDS[kind])
    np.testing.assert_allclose(twice[1], plain / (2 * numbers.reshape(-1, 1)), rtol=1e-15)


@pytest.mark.parametrize("kind", ["gradiometers", "total field"])
def test_the_answer_weighs_each_number_and_is_that_of_whitened_rows(kind):
    _, numbers = deviations(kind)
    y = gm.dipole.simulate(R0, V, M, T, numbers, 3, **KINDS[kind])
    found = gm.dipole.localize(T, y, sigma=numbers, **KINDS[kind])
    assert found.status == "determined", found.reason
    rows = gm.dipole.rows(found.r0, found.v, found.m, T, numbers, **KINDS[kind])
    np.testing.assert_allclose(found.pass_covariance, np.linalg.inv(rows.T @ rows), rtol=1e-5)
    left = (found.residuals / numbers).ravel()
    assert found.cost == pytest.approx(left @ left, rel=1e-9)
    # The least squares have no slope left.
    slope = rows.T @ left / np.linalg.norm(rows, axis=0)
    assert abs(slope).max() < 1e-4 * np.linalg.norm(left)
    np.testing.assert_allclose(found.sigmas, numbers, rtol=1e-15)


def test_what_has_an_infinite_deviation_is_not_used():
    kind = KINDS["gradiometers"]
    sigma = np.full((3, 3), 1e-12)
    y = gm.dipole.simulate(R0, V, M, T, 1e-12, 3, **kind)
    use = np.ones((3, 3), dtype=bool)
    use[1, 2] = use[2, 0] = False
    masked = gm.dipole.localize(T, y, sigma=1e-12, use=use, **kind)
    sigma[~use] = np.inf
    y[:, ~use] = np.nan
    found = gm.dipole.localize(T, y, sigma=sigma, background="fit", **kind)
    assert found.dropped == 0
    assert len(found.names) == 9 + 7
    found = gm.dipole.localize(T, y, sigma=sigma, **kind)
    np.testing.assert_array_equal(found.state, masked.state)
    np.testing.assert_array_equal(found.pass_std, masked.pass_std)
    assert found.fit == masked.fit
    assert found.fit.dof == 7 * len(T) - 9
    assert found.explained == masked.explained
    # So it is in a simulated record, in rows and of many.
    again = gm.dipole.simulate(R0, V, M, T, sigma, 3, **kind)
    np.testing.assert_array_equal(again, y)
    many = gm.dipole.localize_many(T, y[None], sigma=sigma, **kind)
    np.testing.assert_array_equal(many.states[0], [*found.r0, *found.v, *found.m])
    rows = gm.dipole.rows(R0, V, M, T, sigma, **kind).reshape(len(T), 3, 3, 9)
    assert not rows[:, ~use].any()
    assert rows[:, use].any(axis=-1).all()


@pytest.mark.parametrize("kind", ["gradiometers", "total field"])
def test_trials_with_a_deviation_of_each_number_meet_the_bound(kind):
    trials, (_, sigma) = 80, deviations(kind)
    sigma[::5, -1] = np.inf
    found = gm.dipole.localize_trials(R0, V, M, T, sigma, 1, trials, **KINDS[kind])
    errors = found - np.concatenate([R0, V, M])
    nees = ((gm.dipole.rows(R0, V, M, T, sigma, **KINDS[kind]) @ errors.T) ** 2).sum(axis=0)
    assert abs(nees.mean() / 9 - 1) < 3 * np.sqrt(2 / 9 / trials)
    # The trials are those of simulate.
    y = gm.dipole.simulate(R0, V, M, T, sigma, 1, trials=16, **KINDS[kind])
    one = gm.dipole.localize(T, y[0], sigma=sigma, **KINDS[kind])
    np.testing.assert_allclose(np.concatenate([one.r0, one.v, one.m]), found[0], rtol=1e-6)
    held = 0
    for record in y:
        answer = gm.dipole.localize(T, record, sigma=sigma, **KINDS[kind])
        low, high = answer.interval("speed").pieces[0]
        held += low < np.linalg.norm(V) < high
    assert held >= 12, "95 % of 16, less three deviations"


def test_noise_of_each_channel_goes_with_all_else_that_is_asked():
    kind, (channels, _) = KINDS["gradiometers"], deviations("gradiometers")
    y = gm.dipole.simulate(R0, V, M, T, channels, 3, **kind)
    y[7] += 1e-6
    robust = gm.dipole.localize(T, y, background="fit", loss="huber", sigma=channels, **kind)
    assert abs(robust.r0 - R0).max() < 0.1
    assert robust.spikes >= 3
    y = gm.dipole.simulate(R0, V, M, T, channels, 4, **kind)
    found = gm.dipole.localize(T, y, sigma=channels, correlation="fit", sources=(1, 2), **kind)
    assert found.candidates[0][0].sources == 1
    assert found.correlation < 0.3
    assert "sigma 1e-12 to 4e-12 T" in found.summary()
    part = gm.dipole.localize(T, y, sigma=np.tile(channels, (len(T), 1, 1)), window=(2, 18), **kind)
    assert part.sigmas.shape == part.residuals.shape
    wide = part.widened()
    np.testing.assert_allclose(wide.sigmas, part.sigmas * wide.sigma / part.sigma)


@pytest.mark.parametrize(
    ("sigma", "message"),
    [
        (np.ones((2, 3)), r"sigma has shape \(2, 3\): must be \(\), \(42,\) of times, \(1, 3\)"),
        ([[1e-12, -1e-12, 1e-12]], r"sigma\[0, 1\] = -1e-12 T: must be > 0"),
        ([[1e-12, np.nan, 1e-12]], r"sigma\[0, 1\] = nan T: must be > 0"),
        (np.full((1, 3), np.inf), "sigma is infinite throughout: nothing was measured"),
    ],
)
def test_deviations_that_are_none_are_told(sigma, message):
    y = gm.dipole.measure(R0, V, M, T)
    with pytest.raises(gm.InputError, match=message):
        gm.dipole.localize(T, y, {"z": 5.0}, sigma=sigma)
    with pytest.raises(gm.InputError, match=message):
        gm.dipole.simulate(R0, V, M, T, sigma, 1)
    with pytest.raises(gm.InputError, match=message):
        gm.dipole.localize_trials(R0, V, M, T, sigma, 1, 2, known={"z": 5.0})


def test_check_record_estimates_the_deviations_that_localize_takes():
    t = np.arange(0.0, 21.0, 0.05)
    sigma = 1e-10 * np.array([[1.0, 2.0, 1.0], [1.0, 1.0, 3.0]])
    y = gm.dipole.simulate(R0, V, M, t, sigma, 3, sensors=ARRAY[:2])
    told = gm.dipole.check_record(t, y).sigma.reshape(2, 3)
    np.testing.assert_allclose(told, sigma, rtol=0.2)
    found = gm.dipole.localize(t, y, sensors=ARRAY[:2], sigma=told)
    best = gm.dipole.localize(t, y, sensors=ARRAY[:2], sigma=sigma)
    one = gm.dipole.localize(t, y, sensors=ARRAY[:2])
    np.testing.assert_allclose(found.pass_std, best.pass_std, rtol=0.2)
    assert (best.pass_std < one.pass_std).all()
