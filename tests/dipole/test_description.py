"""Records of more than one dipole on a straight pass: dipoles chosen by BIC, motions, sensors."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.dipole import Description, DipoleModel

TIMES = np.arange(0.0, 20.0, 0.5)
SENSORS = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0]]
R0, V = np.array([-10.0, -10.0, 10.0]), np.array([1.0, 1.0, 0.0])
M, OFFSET, SECOND = (
    np.array([10.0, 20.0, 10.0]),
    np.array([1.6, 1.2, 0.0]),
    np.array([-12.0, 8.0, 15.0]),
)
KNOWN = {"z": 10.0, "vz": 0.0}
SIGMA = 1e-12


def record(seed, *more, description=None, sigma=SIGMA):
    """A noisy record of the body with these further states."""
    known = {name + "0" * (len(name) == 1): value for name, value in KNOWN.items()}
    model = DipoleModel(
        TIMES,
        np.array(SENSORS),
        np.ones((TIMES.size, 3, 3)),
        np.concatenate([R0, V, M]),
        known,
        {},
        description=description or Description(),
    )
    truth = np.concatenate([R0[:2], V[:2], M, *more])
    noise = np.random.default_rng(seed).normal(size=(TIMES.size, 3, 3)) * sigma
    return model.h(truth).reshape(noise.shape) + noise, truth


def test_two_dipoles_are_chosen_and_located_at_the_bound():
    errors = []
    for seed in range(2):
        y, truth = record(seed, OFFSET, SECOND, description=Description(sources=2))
        found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, sources=(1, 2, 3))
        assert found.candidates[0][0] == Description(sources=2)
        assert found.names[7] == "dx of dipole 2"
        assert found.status == "determined"
        # Which of the two is called the first is not said.
        other = np.concatenate([truth[:2] + OFFSET[:2], V[:2], SECOND, -OFFSET, M])
        off = min((found.state - x for x in (truth, other)), key=lambda e: np.abs(e[:2]).sum())
        errors.append(off @ np.linalg.solve(found.covariance, off) / 13)
    assert np.mean(errors) < 2.5


@pytest.mark.parametrize(
    ("dipoles", "apart", "seed"),
    [(2, 2.0, 10), (2, 2.0, 14), (2, 2.0, 26), (2, 5.0, 1), (2, 5.0, 33), (3, 3.0, 37)],
)
def test_several_dipoles_reach_the_minimum_at_the_truth(dipoles, apart, seed):
    """From where the rows foretell the most, these end at a lesser minimum."""
    draw = np.random.default_rng(1000 + seed)

    def direction():
        step = draw.normal(size=3)
        return step / np.linalg.norm(step)

    times, given = np.arange(0.0, 20.0, 0.5), {"z": 10.0, "vz": 0.0}
    near = np.concatenate([[-10.0, -10.0, 10.0, 1.0, 1.0, 0.0], 15 * direction()])
    more = [
        part
        for _ in range(dipoles - 1)
        for part in (apart * direction(), draw.uniform(8, 25) * direction())
    ]
    heads = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0]])
    model = DipoleModel(
        times, heads, np.full((times.size, 3, 3), 1e12), near, {"z0": 10.0, "vz": 0.0}, {},
        description=Description(sources=dipoles),
    )  # fmt: skip
    truth = np.concatenate([near[[0, 1, 3, 4, 6, 7, 8]], *more])
    noise = 1e-12 * np.random.default_rng(seed).normal(size=(times.size, 3, 3))
    field = model.h(truth).reshape(noise.shape) + noise
    best = model.handle(field).minimize(truth[None], ("squares", 0.0), 500)[0]["chi2"]
    found = gm.dipole.localize(times, field, given, sensors=heads, sigma=1e-12, sources=dipoles)
    assert found.cost < best + 0.01


def test_a_body_of_two_taken_for_one_is_a_misfit_whatever_noise_is_fitted():
    """The second at a distance where one dipole explains most of the field."""
    times = np.arange(0.0, 20.0, 0.1)
    model = DipoleModel(
        times, np.array(SENSORS), np.ones((times.size, 3, 3)), np.concatenate([R0, V, M]),
        {"z0": 10.0, "vz": 0.0}, {}, description=Description(sources=2),
    )  # fmt: skip
    truth = np.concatenate([R0[:2], V[:2], M, OFFSET, 0.4 * SECOND])
    white = np.random.default_rng(1).normal(size=(times.size, 3, 3))
    slow = white.copy()
    for k in range(1, len(slow)):
        slow[k] = 0.9 * slow[k - 1] + np.sqrt(1 - 0.81) * white[k]
    field = model.h(truth).reshape(white.shape)
    options = {"sensors": SENSORS, "correlation": "fit", "background": "fit"}
    found = gm.dipole.localize(times, field + 1e-12 * slow, KNOWN, **options)
    assert found.explained > 0.9
    assert found.status == "misfit"


def test_correlated_noise_does_not_grow_with_the_field():
    times = np.arange(0.0, 20.0, 0.1)
    for seed in range(4):
        slow = np.random.default_rng(seed).normal(size=(times.size, 3, 3))
        for k in range(1, len(slow)):
            slow[k] = 0.9 * slow[k - 1] + np.sqrt(1 - 0.81) * slow[k]
        place = R0 + times[:, None] * V
        field = np.stack(
            [gm.dipole.field(place - s, np.tile(M, (times.size, 1))) for s in SENSORS], 1
        )
        found = gm.dipole.localize(
            times, field + 1e-11 * slow, KNOWN, sensors=SENSORS, correlation="fit", background="fit"
        )
        assert found.status != "misfit", found.reason


def test_of_one_dipole_one_is_chosen():
    for seed in range(4):
        y, _ = record(seed)
        found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, sources=(1, 2))
        assert found.candidates[0][0].sources == 1


@pytest.mark.parametrize(
    ("motion", "more"),
    [("along", [0.02]), ("turning", [0.03]), ("accelerated", [0.01, -0.02, 0.005])],
)
def test_motions_are_chosen_and_found(motion, more):
    y, truth = record(3, more, description=Description(motion=motion))
    wanted = {"sensors": SENSORS, "sigma": SIGMA}
    assert gm.dipole.localize(TIMES, y, KNOWN, **wanted).status == "misfit"
    found = gm.dipole.localize(TIMES, y, KNOWN, **wanted, motion=("straight", motion))
    assert found.candidates[0][0].motion == motion
    assert found.status == "determined"
    off = (found.state - truth) / found.std
    assert abs(off).max() < 4.5
    blank = found.model.record(np.zeros(y.size))
    places = np.array([blank.place(truth, t)[0] for t in np.linspace(0, 20, 401)])
    near = found.interval("range")
    assert near.value == pytest.approx(np.linalg.norm(places, axis=1).min(), rel=1e-3)


def test_errors_of_the_sensors_widen_what_follows():
    y, _ = record(5)
    wanted = {"sensors": SENSORS, "sigma": SIGMA, "background": "fit"}
    exact = gm.dipole.localize(TIMES, y, KNOWN, **wanted)
    loose = gm.dipole.localize(TIMES, y, KNOWN, **wanted, attitude=0.02, scale=0.01)
    assert "attitude x of sensor 2" in loose.names
    assert "scale of sensor 3" in loose.names
    free = exact.pass_std > 0
    assert (loose.pass_std[free] > 1.5 * exact.pass_std[free]).all()
    assert loose.status in ("determined", "weak")


def test_a_drift_of_the_background_is_fitted():
    y, truth = record(6)
    y = y + 1e-11 * (TIMES[:, None, None] - 4) + 2e-5
    flat = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, background="fit")
    assert flat.status == "misfit"
    found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, background="drift")
    assert found.status == "determined"
    drift = found.state[[name.startswith("drift") for name in found.names]]
    np.testing.assert_allclose(drift, 1e-11, rtol=0.3)
    assert abs((found.state[:7] - truth) / found.std[:7]).max() < 4.5


def test_bad_descriptions():
    y, _ = record(1)
    for options, message in [
        ({"sources": 0}, "sources = 0: must be >= 1"),
        ({"sources": 5}, "sources = 5: must be <= 4"),
        ({"sources": ()}, "at least one"),
        ({"motion": "round"}, "motion = 'round': must be"),
        ({"attitude": -0.1}, r"attitude \[rad\] = -0\.1: must be > 0"),
        ({"scale": 0.0}, r"scale = 0\.0: must be > 0"),
    ]:
        with pytest.raises(gm.InputError, match=message):
            gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, **options)


def turning(rng=None, sigma=0.0):
    """Return times and fields of a body that turns, with a permanent and an induced moment."""
    t = np.arange(0.0, 30.0, 0.5)
    rate, earth = 0.06, np.array([2e-5, -1e-6, -4.5e-5])
    course = np.pi / 4 + rate * t
    # Clockwise from y, at sqrt 2 m/s.
    speed, at = np.sqrt(2.0), np.array([-10.0, -10.0])
    place = np.zeros((t.size, 3))
    place[:, 0] = at[0] - speed / rate * (np.cos(course) - np.cos(np.pi / 4))
    place[:, 1] = at[1] + speed / rate * (np.sin(course) - np.sin(np.pi / 4))
    place[:, 2] = 5.0
    permanent, volume = np.array([10.0, 20.0, 10.0]), 0.4
    sin, cos = np.sin(rate * t), np.cos(rate * t)
    x, y, z = permanent
    moment = np.stack([x * cos + y * sin, y * cos - x * sin, np.full(t.size, z)], axis=1)
    moment += volume * earth / gm.dipole.MU0
    field = gm.dipole.field(place, moment)
    if rng is not None:
        field = field + sigma * rng.normal(size=field.shape)
    return t, field, earth, permanent, volume, rate


def test_a_body_that_turns_tells_its_permanent_from_its_induced_moment():
    known = {"z": 5.0, "vz": 0.0}
    t, field, earth, permanent, volume, rate = turning()
    options = {"motion": "turning", "sigma": 1e-10}
    exact = gm.dipole.localize(t, field, known, earth_field=earth, **options)
    assert exact["induced volume"] == pytest.approx(volume, rel=1e-5)
    assert exact["turn rate"] == pytest.approx(rate, rel=1e-5)
    assert exact.m == pytest.approx(permanent, rel=1e-4)
    inside = 0
    for seed in range(12):
        t, seen, *_ = turning(np.random.default_rng(seed), 1e-9)
        noisy = {"motion": "turning", "sigma": 1e-9}
        found = gm.dipole.localize(t, seen, known, earth_field=earth, **noisy)
        inside += volume in found.interval("induced volume")
    assert inside >= 9
    # Without it the field of the two is no turning dipole's.
    assert gm.dipole.localize(t, field, known, **options).status == "misfit"


def test_a_straight_pass_does_not_tell_them_apart():
    t = np.arange(0.0, 20.0, 0.5)
    seen = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-9, seed=1)
    with pytest.raises(gm.UnobservableError, match=r"mx .*mz .*induced volume .* not determined"):
        gm.dipole.localize(
            t, seen, {"z": 5.0, "vz": 0.0}, sigma=1e-9, earth_field=[2e-5, 0.0, -4e-5]
        )
    with pytest.raises(gm.InputError, match="earth_field"):
        gm.dipole.localize(t, seen, {"z": 5.0, "vz": 0.0}, earth_field=[0.0, 0.0, 0.0])


@pytest.mark.parametrize("motion", ["straight", "along", "accelerated", "turning"])
def test_the_range_of_several_dipoles_is_that_of_their_centre(motion):
    description = Description(motion, 2)
    model = DipoleModel(
        TIMES,
        np.array(SENSORS),
        np.ones((TIMES.size, 3, 3)),
        np.concatenate([R0, V, M]),
        {},
        {},
        description=description,
    )
    more = {"straight": [], "along": [0.02], "accelerated": [0.02, -0.01, 0.03], "turning": [0.04]}
    x = np.concatenate([R0, V, M, more[motion], OFFSET, SECOND])
    # The share of the moment along the sum: of two alike the middle.
    total = M + SECOND
    centre, by = model.centre(x)
    np.testing.assert_allclose(centre, OFFSET * (SECOND @ total) / (total @ total))
    time, by_time, place, _ = model.nearest(x)
    dense = np.linspace(0.0, TIMES[-1], 4001)
    if motion == "straight":
        track = R0 + centre + dense[:, None] * V
        distance = np.linalg.norm(track, axis=1)
        assert time == pytest.approx(dense[distance.argmin()], abs=0.005)
        assert np.linalg.norm(place) == pytest.approx(distance.min(), rel=1e-6)
    functions = model.functions
    for j in range(x.size):
        step = np.zeros(x.size)
        step[j] = 1e-5
        np.testing.assert_allclose(
            (model.centre(x + step)[0] - model.centre(x - step)[0]) / 2e-5, by[:, j], atol=1e-7
        )
        # The time of a least value has half of its digits.
        moved = (model.nearest(x + 100 * step)[0] - model.nearest(x - 100 * step)[0]) / 2e-3
        assert moved == pytest.approx(by_time[j], rel=1e-3, abs=1e-3)
        for name in ("range", "moment"):
            value = functions[name][0]
            slope = (value(x + step)[0] - value(x - step)[0]) / 2e-5
            assert slope == pytest.approx(value(x)[1][j], rel=1e-5, abs=1e-6), (name, j)


def test_the_closest_point_of_an_accelerated_pass_is_on_its_track():
    truth = np.array([0.03, -0.02, 0.0])
    description = Description("accelerated")
    y, _ = record(5, truth, description=description)
    found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, motion="accelerated")
    dense = np.linspace(0.0, TIMES[-1], 20001)[:, None]
    distance = np.linalg.norm(R0 + dense * V + 0.5 * dense**2 * truth, axis=1)
    near = found.closest
    assert abs(near.range - distance.min()) < 4 * near.range_std + 1e-6
    assert abs(near.time - dense[distance.argmin(), 0]) < 4 * near.time_std + 1e-3
    assert near.range == pytest.approx(found["range"])
    assert near.range_std < 0.1


def test_the_moment_of_several_dipoles_is_their_sum():
    y, _ = record(0, OFFSET, SECOND, description=Description(sources=2))
    found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, sources=2)
    size, std = found.moment
    assert abs(size - np.linalg.norm(M + SECOND)) < 4 * std
    assert std < 1.0
    assert found["moment"] == size
    assert f"moment {size:.4g}"[:9] in found.summary()
