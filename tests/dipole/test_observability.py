"""What the field of a passing dipole determines: rows, information, null combinations."""

import json
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

# 50-digit values of two passes, from mpmath, sigma = 1 nT. D1 is Table 1 of Dai, Zhou & Shan 2020.
REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "dipole.json").read_text())

TABLE_1 = ([-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0])
TIMES = np.arange(21.0)


def random_passes(count, seed=0, times=TIMES):
    rng = np.random.default_rng(seed)
    passes = []
    while len(passes) < count:
        r0, m = rng.normal(size=3) * 10, rng.normal(size=3) * 30
        v = rng.normal(size=3)
        if np.linalg.norm(r0 + times[:, None] * v, axis=1).min() > 1:
            passes.append((r0, v, m))
    return passes


@pytest.fixture(params=["D1", "D2"])
def reference(request):
    case = REFERENCE[request.param]
    p = case["params"]
    return case, (
        p["r0_m"],
        p["v_mps"],
        p["m_Am2"],
        float(p["T_s"]) * np.arange(p["N"]),
        float(p["sigma_T"]),
    )


def test_fisher_matches_the_reference(reference):
    case, args = reference
    j = gm.dipole.fisher(*args)
    assert j[0, 0] == pytest.approx(float(case["J00"]), rel=1e-12)
    assert j[3, 6] == pytest.approx(float(case["J36"]), rel=1e-12)
    wanted = np.array([float(x) for x in case["fim_eigs"]])
    eigenvalues = np.linalg.eigvalsh(j)
    np.testing.assert_allclose(eigenvalues[1:], wanted[1:], rtol=1e-9)
    assert abs(eigenvalues[0]) < 1e-12 * eigenvalues[-1]


@pytest.mark.parametrize(
    ("key", "known"),
    [
        ("crlb_std_z0_known", ["z0"]),
        ("crlb_std_z0_vz_known", ["z0", "vz"]),
        ("crlb_std_vx_known", ["vx"]),
    ],
)
def test_bounds_match_the_reference(reference, key, known):
    case, args = reference
    std = gm.crlb_std(gm.dipole.problem(*args).fix(*known))
    np.testing.assert_allclose(std, [float(x) for x in case[key]], rtol=1e-9)


def test_jacobians_match_differences():
    rng = np.random.default_rng(1)
    for _ in range(50):
        r, m = rng.normal(size=3) * 5, rng.normal(size=3) * 20
        j = gm.dipole.jacobian(r, m)
        step = 1e-3 * np.linalg.norm(r)

        def difference(axis, h, r=r, m=m):
            move = np.zeros(3)
            move[axis] = h
            return (gm.dipole.field(r + move, m) - gm.dipole.field(r - move, m)) / (2 * h)

        # Sixth order: steps h, h/2 and h/4.
        for axis in range(3):
            a, b, c = (difference(axis, step / k) for k in (1, 2, 4))
            ab, bc = (4 * b - a) / 3, (4 * c - b) / 3
            column = (16 * bc - ab) / 15
            assert abs(column - j.position[:, axis]).max() < 1e-8 * abs(j.position).max()
            unit = np.eye(3)[axis]
            np.testing.assert_allclose(
                gm.dipole.field(r, unit),
                j.moment[:, axis],
                rtol=0,
                atol=1e-15 * abs(j.moment).max(),
            )


def test_rows_are_the_derivatives_of_what_is_measured():
    sensors = [[0, 0, 0], [0.5, -0.2, 0.1]]
    x = np.array([-8, 3, 2, 1.6, -0.1, 0.05, 40, -25, 80.0])
    times = 0.25 * np.arange(41)
    # At 1 uT the field turns the ambient one noticeably, so that |B + h| is not linear in h.
    for ambient in (None, [1e-6, 0, 2e-6]):
        problem = gm.from_function(
            lambda x, ambient=ambient: gm.dipole.measure(
                x[:3], x[3:6], x[6:], times, sensors=sensors, ambient=ambient
            ).ravel(),
            x,
            1e-9,
            gm.dipole.NAMES,
        )
        rows = gm.dipole.rows(x[:3], x[3:6], x[6:], times, 1e-9, sensors=sensors, ambient=ambient)
        assert abs(rows - problem.rows()).max() < 1e-8 * abs(rows).max()


def test_fisher_is_the_sum_over_rows_for_batches_sensors_and_sigmas():
    rng = np.random.default_rng(2)
    r0, v, m = (rng.normal(size=(4, 3)) * s for s in (10, 1, 30))
    sigma = 1e-9 * rng.uniform(1, 2, size=21)
    sensors = [[0, 0, 0], [0.5, 0, 0], [0, 0.4, -0.1]]
    j = gm.dipole.fisher(r0, v, m, TIMES, sigma, sensors=sensors)
    wanted = gm.gram(gm.dipole.rows(r0, v, m, TIMES, sigma, sensors=sensors))
    size = np.sqrt(np.einsum("tii,tjj->tij", wanted, wanted))
    assert (abs(j - wanted) / size).max() < 1e-12


def test_the_null_direction_of_every_pass():
    worst = 0.0
    for r0, v, m in random_passes(1000):
        rows = gm.dipole.rows(r0, v, m, TIMES, 1e-9)
        null = np.concatenate([r0, v, 3 * m])
        worst = max(worst, (abs(rows @ null) / (abs(rows) @ abs(null))).max())
    assert worst < 1e-14


def test_every_random_pass_has_rank_8_and_analyze_names_the_combination():
    for r0, v, m in random_passes(1000):
        answer = gm.analyze(gm.dipole.problem(r0, v, m, TIMES, 1e-9))
        assert answer.rank == 8
        null = np.concatenate([r0, v, 3 * m])
        found = answer.null_space[:, 0]
        # Compared where the columns have unit length, the scale of the rank decision.
        norms = np.linalg.norm(answer.problem.rows, axis=0)
        found, null = found * norms, null * norms
        cosine = abs(found @ null) / np.linalg.norm(found) / np.linalg.norm(null)
        assert cosine == pytest.approx(1, abs=1e-12)


def test_special_passes():
    r0, m = [-10.0, -4.0, 3.0], [10.0, 20.0, 10.0]
    ambient = [2e-5, 0, 4e-5]

    def nullity(v, m=m, **more):
        return gm.analyze(gm.dipole.problem(r0, v, m, TIMES, 1e-9, **more)).nullity

    assert nullity([1.0, 0.5, 0.2]) == 1
    assert nullity([2.2, 0.88, -0.66]) == 3, "radial, between samples over the sensor"
    assert nullity([0.0, 0.0, 0.0]) == 3, "at rest"
    v = np.array([1.0, 0.5, 0.2])
    assert nullity(v, np.cross(r0, v)) == 2, "moment across the plane of the pass"
    assert nullity(v, sensors=[[0, 0, 0], [0, 0.5, 0]]) == 0, "two sensors"
    assert nullity(v, ambient=ambient) == 2, "scale, and a turn about the ambient field"


def test_knowledge_repairs_only_where_the_null_vector_has_a_part():
    answer = gm.analyze(gm.dipole.problem(*TABLE_1, TIMES, 1e-9))
    repaired = {s.name for s in answer.suggestions if s.repairs}
    assert repaired == {*gm.dipole.NAMES, "speed", "moment", "range"} - {"vz"}
    flat = gm.analyze(gm.dipole.problem([-10, -10, 0], [1, 1, 0.1], [10, 20, 10], TIMES, 1e-9))
    assert not flat.knowing("z0").repairs
    assert flat.knowing("vz").repairs
    known = gm.analyze(gm.dipole.problem(*TABLE_1, TIMES, 1e-9), prior={"speed": 0.1})
    assert known.rank == 9
    assert np.isfinite(known.crlb_std).all()


def test_equivalents_make_the_same_field_and_a_negative_scale_the_opposite():
    here = gm.dipole.measure(*TABLE_1, TIMES)
    for u in (0.3, 2.0, 17.0):
        for other in gm.dipole.equivalents(*TABLE_1, u).values():
            there = gm.dipole.measure(*other, TIMES)
            assert abs(there - here).max() < 1e-14 * abs(here).max()
    r0, v, m = (np.array(x) for x in TABLE_1)
    opposite = gm.dipole.measure(-2 * r0, -2 * v, -8 * m, TIMES)
    assert abs(opposite + here).max() < 1e-14 * abs(here).max()
    with pytest.raises(gm.InputError, match=r"scale = -2\.0: must be > 0.*turns the sign"):
        gm.dipole.equivalents(*TABLE_1, -2.0)


def test_bad_input_is_named():
    with pytest.raises(gm.InputError, match="sample 10: the dipole is on the sensor"):
        gm.dipole.rows([-10, -10, 0], [1, 1, 0], [1, 2, 3], TIMES, 1e-9)
    with pytest.raises(gm.InputError, match=r"at batch index \[1\]: sample 10"):
        gm.dipole.fisher([[-10, 1, 0], [-10, 0, 0]], [1, 0, 0], [1, 2, 3], TIMES, 1e-9)
    with pytest.raises(gm.InputError, match="dipole is on the sensor"):
        gm.dipole.field([0, 0, 0], [1, 2, 3])
    with pytest.raises(gm.InputError, match=r"sigma\[3\] = -1 T: must be > 0"):
        gm.dipole.rows(*TABLE_1, TIMES[:5], [1, 1, 1, -1, 1])
    with pytest.raises(gm.InputError, match=r"times\[2\] = 1 s: must be later"):
        gm.dipole.rows(*TABLE_1, [0, 1, 1], 1e-9)
    with pytest.raises(gm.InputError, match=r"m has shape \(2,\)"):
        gm.dipole.rows([1, 2, 3], [1, 2, 3], [1, 2], TIMES, 1e-9)
    with pytest.raises(gm.InputError, match="must be finite"):
        gm.dipole.rows([1, 2, np.nan], [1, 2, 3], [1, 2, 3], TIMES, 1e-9)
    with pytest.raises(gm.InputError, match="no rotation"):
        gm.dipole.moment([1, 0, 0], 2 * np.eye(3), 1.0, [0, 0, 5e-5])
    with pytest.raises(gm.InputError, match="ambient"):
        gm.dipole.measure(*TABLE_1, TIMES, ambient=[0, 0, 0])


def test_the_field_is_that_of_magpylib():
    core = pytest.importorskip("magpylib.core", reason="magpylib comes with the extra bench")
    rng = np.random.default_rng(6)
    r, m = rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3))
    theirs = gm.dipole.MU0 * core.dipole_Hfield(observers=r, moments=m)
    ours = gm.dipole.field(r, m)
    assert (abs(ours - theirs) / np.linalg.norm(ours, axis=1, keepdims=True)).max() < 1e-12
