"""A body that has a quadrupole beside its dipole: found, chosen by BIC, told from a move."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.dipole import Description, DipoleModel

TIMES = np.arange(0.0, 20.0, 0.5)
SENSORS = np.array([[0.0, 0.0, 0.0], [0.0, 1.5, 0.0], [1.5, 0.0, 0.4]])
R0, V, M = np.array([-10.0, -10.0, 6.0]), np.array([1.0, 1.0, 0.0]), np.array([10.0, 20.0, 10.0])
SIGMA = 1e-12
QUADRUPOLE = Description(quadrupole=True)
SOURCES = (1, "quadrupole", 2)


def model(known=None, prior=None, description=QUADRUPOLE, sensors=SENSORS):
    return DipoleModel(
        TIMES, np.asarray(sensors), np.full((TIMES.size, len(sensors), 3), 1 / SIGMA),
        np.concatenate([R0, V, M]), known or {}, prior or {}, description=description,
    )  # fmt: skip


def record(body, truth, seed):
    """The noisy record of a body, and its states."""
    noise = SIGMA * np.random.default_rng(seed).normal(size=body.weights.shape)
    return body.h(truth).reshape(noise.shape) + noise


def as_told(found, body, truth):
    """The truth in the states of an answer, which may take other entries of the tensor."""
    values, _ = body.quadrupole(truth)
    entries = {f"Q{'xyz'[i]}{'xyz'[j]}": values[i, j] for i in range(3) for j in range(3)}
    named = entries | {
        name: value for name, value in zip(body.names, truth, strict=True) if name[0] != "Q"
    }
    return np.array([named[name] for name in found.names])


def moved(moment, offset):
    """The quadrupole of a dipole about a place from which it is off."""
    both = np.outer(offset, moment)
    return 3 * (both + both.T) - 2 * (offset @ moment) * np.eye(3)


@pytest.mark.parametrize("known", [{}, {"z0": 6.0}, {"z0": 6.0, "vz": 0.0, "x0": -10.0}])
def test_it_is_chosen_and_located_at_the_bound(known):
    body = model(known)
    free = 2 + sum(name in known for name in ("x0", "y0", "z0"))
    numbers = [name for name in body.names if name.startswith("Q")]
    assert len(numbers) == free
    assert body.units[-free:] == ("A m^3",) * free
    truth = body.coordinates(np.concatenate([R0, V, M]))
    truth[-free:] = [150.0, -90.0, 60.0, 120.0][:free]
    errors = []
    for seed in range(3):
        y = record(body, truth, seed)
        found = gm.dipole.localize(
            TIMES, y, known, sensors=SENSORS, sigma=SIGMA, sources=SOURCES
        )  # fmt: skip
        assert found.candidates[0][0] == QUADRUPOLE
        assert str(found.candidates[0][0]) == "1 dipole with a quadrupole, straight"
        assert found.status == "determined"
        off = found.state - as_told(found, body, truth)
        errors.append(off @ np.linalg.solve(found.covariance, off))
        np.testing.assert_allclose(found.quadrupole, found.quadrupole.T)
        assert abs(np.trace(found.quadrupole)) < 1e-9 * abs(found.quadrupole).max()
        along = found.quadrupole @ found.m
        centre = [name not in known for name in ("x0", "y0", "z0")]
        assert abs(along[centre]).max() < 1e-9 * abs(found.quadrupole).max() * found.moment[0]
    # Chi-square of as many degrees of freedom as there are states, of which the mean is taken.
    states = truth.size
    assert np.mean(errors) < states + 4 * np.sqrt(2 * states / 3)


def test_of_one_dipole_none_is_chosen():
    body = model(description=Description())
    for seed in range(4):
        y = record(body, body.x, seed)
        found = gm.dipole.localize(TIMES, y, sensors=SENSORS, sigma=SIGMA, sources=SOURCES)
        assert found.candidates[0][0] == Description()
        assert not found.quadrupole.any()


def test_a_dipole_that_is_moved_is_found_where_it_is_without_one():
    """The quadrupole of a move is the move: what is left at the centre is nothing."""
    plain = model(description=Description())
    y = record(plain, plain.x, 1)
    found = gm.dipole.localize(TIMES, y, sensors=SENSORS, sigma=SIGMA, sources="quadrupole")
    assert abs((found.r0 - R0) / found.pass_std[:3]).max() < 4.5
    numbers = [name.startswith("Q") for name in found.names]
    assert abs(found.state[numbers] / found.std[numbers]).max() < 4.5
    # About another place, the x of which is known, it has the quadrupole of the move.
    off = 0.05
    known = gm.dipole.localize(
        TIMES, y, {"x0": R0[0] - off}, sensors=SENSORS, sigma=SIGMA, sources="quadrupole"
    )
    along = moved(M, np.array([off, 0.0, 0.0])) @ M
    part = known.quadrupole @ M
    assert part[0] == pytest.approx(along[0], rel=0.1)


def test_two_dipoles_close_together_are_a_quadrupole_about_their_centre():
    """The nearer they are, the less of an octupole is left: of the first order."""
    second = np.array([-6.0, -9.0, 14.0])
    total = M + second
    two = model(description=Description(sources=2))
    errors = []
    for size in (1.0, 0.25):
        apart = size * np.array([0.1, -0.07, 0.08])
        y = two.h(np.concatenate([R0, V, M, apart, second])).reshape(two.weights.shape)
        found = gm.dipole.localize(TIMES, y, sensors=SENSORS, sigma=SIGMA, sources="quadrupole")
        # About the place of the first the body has the quadrupole of the second's offset; its
        # centre is where what is left of that has nothing along the moment.
        whole = moved(second, apart)
        moves = np.array([moved(total, unit) @ total for unit in np.eye(3)])
        shift = np.linalg.solve(moves.T, whole @ total)
        left = whole - moved(total, shift)
        off = found.r0 - R0 - shift, found.quadrupole - left, found.m - total
        scales = np.linalg.norm(apart), abs(left).max(), np.linalg.norm(total)
        errors.append([abs(o).max() / scale for o, scale in zip(off, scales, strict=True)])
    plain = gm.dipole.localize(TIMES, y, sensors=SENSORS, sigma=SIGMA)
    assert found.fit.chi2 < 1e-2 * plain.fit.chi2
    assert max(errors[0]) < 0.1
    assert (np.array(errors[1]) < 0.4 * np.array(errors[0])).all()


def test_one_sensor_cannot_tell_the_size_nor_the_mirror_image():
    body = model(sensors=SENSORS[:1])
    truth = body.x
    truth[-2:] = [150.0, -90.0]
    null = truth * np.repeat([1, 3, 4], [6, 3, 2])
    rows = body.rows(truth)
    assert (abs(rows @ null) < 1e-12 * (abs(rows) @ abs(null))).all()
    assert gm.analyze(rows).nullity == 1
    y = record(body, truth, 3)[:, 0]
    with pytest.raises(gm.UnobservableError, match="1 dipole with a quadrupole, straight"):
        gm.dipole.localize(TIMES, y, sigma=SIGMA, sources="quadrupole")
    speed = {"speed": float(np.linalg.norm(V))}
    found = gm.dipole.localize(TIMES, y, speed, sigma=SIGMA, sources="quadrupole")
    assert found.status == "ambiguous"
    image = found.model.quadrupole(found.others[0].state)[0]
    np.testing.assert_allclose(found.mirror.r0, -found.r0, rtol=1e-3)
    np.testing.assert_allclose(image, -found.quadrupole, rtol=1e-3)


def test_a_turning_body_turns_its_quadrupole():
    about = Description(motion="turning", quadrupole=True)
    body = model(description=about)
    truth = np.concatenate([R0, V, M, [0.05], [150.0, -90.0]])
    y = record(body, truth, 2)
    found = gm.dipole.localize(
        TIMES, y, sensors=SENSORS, sigma=SIGMA, motion="turning", sources=(1, "quadrupole")
    )
    assert found.candidates[0][0] == about
    assert found.status == "determined"
    assert abs((found.state - as_told(found, body, truth)) / found.std).max() < 4.5


def test_rows_and_readings_of_a_body_with_a_quadrupole():
    """Those of a record's model; one sensor sees all but the size, and at Q = 0 all but a move."""
    whole = np.array([[150.0, 40.0, -30.0], [40.0, -90.0, 20.0], [-30.0, 20.0, -60.0]])
    prior = dict.fromkeys(("x0", "y0", "z0"), (0.0, 1e3))
    body = model(prior=prior)
    truth = np.concatenate([R0, V, M, whole[[0, 1, 0, 0, 1], [0, 1, 1, 2, 2]]])
    given = {"sensors": SENSORS, "quadrupole": whole}
    field = gm.dipole.measure(R0, V, M, TIMES, **given)
    np.testing.assert_allclose(field.ravel(), body.h(truth), rtol=1e-12, atol=1e-22)
    rows = gm.dipole.rows(R0, V, M, TIMES, SIGMA, **given)
    np.testing.assert_allclose(rows, body.rows(truth), rtol=1e-9, atol=1e-9 * abs(rows).max())
    many = gm.dipole.measure(R0, V, M, TIMES, quadrupole=np.stack([whole, 0 * whole]))
    np.testing.assert_array_equal(many[1], gm.dipole.measure(R0, V, M, TIMES))
    noisy = gm.dipole.simulate(R0, V, M, TIMES, SIGMA, 1, **given)
    assert abs((noisy - field) / SIGMA).max() < 5

    alone = gm.dipole.problem(R0, V, M, TIMES, SIGMA, quadrupole=whole)
    assert alone.names[-5:] == ("Qxx", "Qyy", "Qxy", "Qxz", "Qyz")
    assert alone.units[-5:] == ("A m^3",) * 5
    answer = gm.analyze(alone)
    assert answer.nullity == 1
    size = answer.null_space[:, 0] / answer.null_space[0, 0] * R0[0]
    wanted = np.concatenate([R0, V, 3 * M, 4 * truth[9:]])
    np.testing.assert_allclose(size, wanted, rtol=1e-6, atol=1e-6)
    # Three sensors tell it where it is large, and three of a move where there is none.
    assert gm.analyze(gm.dipole.problem(R0, V, M, TIMES, SIGMA, **given)).nullity == 0
    none = gm.dipole.problem(R0, V, M, TIMES, SIGMA, sensors=SENSORS, quadrupole=0 * whole)
    assert gm.analyze(none).nullity == 3
    assert gm.analyze(none.fix("x0").fix("y0").fix("z0")).nullity == 0


def test_bad_input():
    y = np.ones((TIMES.size, 3, 3))
    for options, message in [
        ({"sources": "octupole"}, "sources = 'octupole': must be from 1 to 4 dipoles, or \"quad"),
        ({"sources": (1, "two")}, "sources = 'two': must be from 1 to 4"),
        ({"sources": "quadrupole", "earth_field": [0, 2e-5, 4e-5]}, "not modelled"),
    ]:
        with pytest.raises(gm.InputError, match=message):
            gm.dipole.localize(TIMES, y, sensors=SENSORS, sigma=SIGMA, **options)
    for given, message in [
        (np.ones(5), r"quadrupole has shape \(5,\): must be \(\.\.\., 3, 3\)"),
        (np.triu(np.ones((3, 3)), 1), "must be symmetric"),
        (np.eye(3), "must have a trace of 0"),
    ]:
        with pytest.raises(gm.InputError, match=message):
            gm.dipole.measure(R0, V, M, TIMES, quadrupole=given)


def test_a_quadrupole_shows_in_the_residuals_of_a_dipole_and_a_move_does_not():
    sensors = np.array([[0.0, 0, 0], [0, 1.5, 0], [1.5, 0, 0.4]])
    t, sigma = np.arange(0.0, 20.0, 0.5), 8e-10
    m = np.array([10.0, 20, 10])
    given = [-10, -10, 6], [1, 1, 0], m, t
    # About the centre: Q m = 0. It is told from a move, which the dipole takes up.
    body = np.array([[150.0, -30, -90], [-30, -36, 102], [-90, 102, -114]])
    y = gm.dipole.simulate(*given, sigma, seed=1, sensors=sensors, quadrupole=body)
    found = gm.dipole.localize(t, y, sensors=sensors, sigma=sigma)
    assert found.status == "misfit"
    shown = {a.name: a for a in found.fit.alternatives}["a quadrupole of the body"]
    assert shown.dof == 2
    # A second dipole farther away looks much the same, one behind does not.
    assert shown in found.fit.alternatives[:2]
    assert shown.p_value < 1e-20
    assert shown.restored > 0.001
    sigma, e = 1e-10, np.array([0.2, -0.1, 0.15])
    moved = 3 * (np.outer(e, m) + np.outer(m, e)) - 2 * (e @ m) * np.eye(3)
    y = gm.dipole.simulate(*given, sigma, seed=1, sensors=sensors, quadrupole=moved)
    assert gm.dipole.localize(t, y, sensors=sensors, sigma=sigma).status == "determined"
    # Where the place is known all five numbers are left, and a move shows.
    known = {"x": -10.0, "y": -10.0, "z": 6.0}
    held = gm.dipole.localize(t, y, known, sensors=sensors, sigma=sigma)
    assert held.status == "misfit"
    assert {a.name: a.dof for a in held.fit.alternatives}["a quadrupole of the body"] == 5
    with_it = gm.dipole.localize(t, y, known, sensors=sensors, sigma=sigma, sources="quadrupole")
    assert "a quadrupole of the body" not in {a.name for a in with_it.fit.alternatives}
