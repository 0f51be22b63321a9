"""Distance and unobservable subspace on the pencil, against exact and published values."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

import gramian as gm
from gramian import _core
from planted import defective, exact_rank, hidden_dimension, planted, unimodular

# Values from ../shared/reference/linear_large.json of the project's theory notes: distance
# by dense search in double precision, dimension exact by construction.
REFERENCE = json.loads(
    (Path(__file__).parents[1] / "reference" / "linear_large.json").read_text(encoding="utf-8")
)["systems"]


def heat_chain(n, node):
    a = -2.0 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)
    return a, np.eye(n)[[node]]


def structures():
    block, positions = np.zeros((20, 20)), np.zeros(20)
    for k in range(10):
        w = 1.3 * (k + 1)
        block[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-w * w, -2 * 0.02 * w]]
        positions[2 * k] = 1
    return scipy.linalg.block_diag(block, block), np.r_[positions, positions][None]


def pairs(n):
    half = np.arange(1.0, n // 2 + 1)
    return np.diag(np.r_[half, half]), np.ones((1, n))


SYSTEMS = {
    "pairs 30": pairs(30),
    "pairs 100": pairs(100),
    "ladder 40": (np.diag(np.arange(1.0, 41)), np.ones((1, 40))),
    "heat chain 60, end": heat_chain(60, 0),
    "heat chain 61, middle": heat_chain(61, 30),
    "two structures, 40 states": structures(),
    "integrators 20": (np.eye(20, k=1), np.eye(20)[:1]),
    "hidden block 24": tuple(np.array(REFERENCE["hidden block 24"][key]) for key in "AC"),
}


def test_every_reference_system_is_tested():
    assert set(SYSTEMS) == set(REFERENCE)


@pytest.mark.parametrize("name", SYSTEMS)
def test_dimension_and_distance_of_the_reference(name):
    a, c = SYSTEMS[name]
    expected = REFERENCE[name]
    found = gm.linear.unobservable(a, c)
    assert found.nullity == expected["unobservable"]
    assert gm.linear.levels(a, c).nullity == expected["unobservable"]
    assert gm.linear.batch_levels(a, c).rank == len(a) - expected["unobservable"]
    away = gm.linear.distance(a, c)
    if expected["unobservable"]:
        assert away.distance < 1e-13 * away.norm
    else:
        assert abs(away.distance / expected["distance"] - 1) < 1e-6
    # It is what it says at its z, and attained by its direction.
    stack = np.vstack([a - away.z * np.eye(len(a)), c])
    smallest = np.linalg.svd(stack, compute_uv=False)[-1]
    assert abs(smallest - away.distance) < 1e-13 * away.norm
    assert abs(np.linalg.norm(stack @ away.direction) - away.distance) < 1e-13 * away.norm


@pytest.mark.parametrize("name", [name for name in SYSTEMS if REFERENCE[name]["unobservable"]])
def test_the_subspace_is_invariant_and_not_seen(name):
    a, c = SYSTEMS[name]
    found = gm.linear.unobservable(a, c)
    v, _ = np.linalg.qr(found.null_space)
    assert np.abs(c @ v).max() < 1e-12 * np.abs(c).max()
    left = a @ v - v @ (v.T @ a @ v)
    assert np.abs(left).max() < 1e-12 * np.abs(a).max()
    assert sum(mode.combinations.shape[1] for mode in found.modes) == found.nullity
    for mode in found.modes:
        u, _ = np.linalg.qr(mode.combinations)
        inner = u.T @ a @ u
        assert np.abs(a @ u - u @ inner).max() < 1e-9 * np.abs(a).max()
        values = np.linalg.eigvals(inner)
        folded = values.real + 1j * np.abs(values.imag)
        assert np.abs(folded - mode.eigenvalue).max() < 1e-6 * max(1, np.abs(a).max())


def test_modes_in_words():
    found = gm.linear.unobservable(*structures())
    slowest = found.modes[0]
    assert abs(slowest.eigenvalue - complex(-0.026, 1.3 * np.sqrt(1 - 0.02**2))) < 1e-9
    assert slowest.motion == "oscillates with period 4.834, damping 0.02"
    assert found.detectable
    assert sorted(slowest.texts) == ["x0 +1, x20 -1", "x1 +1, x21 -1"]
    drift = gm.linear.unobservable([[0, 0], [0, 0.5]], [[0, 0]], ["bias", "runaway"])
    assert not drift.detectable
    assert [mode.motion for mode in drift.modes] == ["grows with time constant 2", "constant"]
    sampled = gm.linear.unobservable([[0.5, 0], [0, 0.25]], [[0, 1]], time="discrete")
    assert sampled.modes[0].motion == "decays with time constant 1.443 samples"
    assert sampled.detectable


def test_which_output_repairs_it():
    a, c = pairs(30)
    found = gm.linear.unobservable(a, c)
    assert set(found.left_by().values()) == {14}
    both = gm.linear.unobservable(a, np.vstack([c, np.r_[np.ones(15), np.zeros(15)]]))
    assert both.nullity == 0
    wanted = {"first half": np.r_[np.ones(15), np.zeros(15)], "the same": np.ones(30)}
    assert found.left_by(wanted) == {"first half": 0, "the same": 15}


@pytest.mark.parametrize("kind", ["integer", "orthogonal"])
@pytest.mark.parametrize("repeated", [False, True])
def test_planted_blocks_are_found_exactly(kind, repeated):
    """A larger run of the same: benches/planted_systems.py."""
    rng = np.random.default_rng(20)
    wrong = []
    for trial in range(40):
        n = int(rng.integers(4, 41))
        hidden = int(rng.integers(1, n // 2 + 1))
        units = 30 if trial % 2 else 0
        a, c = planted(rng, n, hidden, kind, repeated, units)
        found = gm.linear.unobservable(a, c)
        if found.nullity != hidden:
            wrong.append((n, hidden, found.nullity, units))
    assert wrong == []


@pytest.mark.parametrize("kind", ["jordan", "tail", "triangular", "coupled"])
def test_chains_of_defective_eigenvalues_are_found_whole_or_undecided(kind):
    rng = np.random.default_rng(23)
    undecided = 0
    for _ in range(100):
        a, c = defective(rng, kind, int(rng.integers(3, 25)))
        hidden = hidden_dimension(a, c)
        d = 2.0 ** (rng.choice([0, 30]) * rng.integers(-1, 2, len(a)))
        found = gm.linear.unobservable(a * d / d[:, None], c * d)
        if found.undecided:
            undecided += 1
            assert found.nullity >= hidden
            assert found.status == "undecided"
            assert "UNDECIDED" in found.summary()
        else:
            assert found.nullity == hidden
    assert undecided <= 10


@pytest.mark.parametrize("n", [2, 3, 7, 14])
def test_a_multiple_of_the_identity_in_other_coordinates(n):
    # What rounding leaves beside the diagonal couples nothing.
    rng = np.random.default_rng(n)
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    c = rng.normal(size=(1, n))
    for value in (2.0, -3e5, 1e-9):
        a = q @ (value * np.eye(n)) @ q.T
        assert gm.linear.unobservable(a, c).nullity == n - 1
        assert gm.linear.levels(a, c).rank == 1
        assert gm.linear.batch_levels(a, c).rank == 1


def test_small_dynamics_beside_a_large_common_diagonal_are_not_decided_by_rounding():
    rng = np.random.default_rng(5)
    n = 8
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    a, c = rng.integers(-3, 4, (n, n)).astype(float), rng.integers(-3, 4, (1, n)).astype(float)
    a[:5, 5:] = 0
    c[:, 5:] = 0
    # Exact, it is clear; in other coordinates its entries are rounded as the diagonal is.
    for diagonal in (0.0, 1e3, 1e6):
        found = gm.linear.unobservable(a + diagonal * np.eye(n), c)
        assert (found.nullity, found.status) == (3, "unobservable")
    turned = q @ (a + 1e7 * np.eye(n)) @ q.T
    found = gm.linear.unobservable(turned, c @ q.T)
    assert found.nullity >= 3
    assert found.status == "undecided"
    assert gm.linear.levels(turned, c @ q.T).undecided
    # A sampled system near the identity keeps its digits.
    sampled = gm.linear.unobservable([[1.0, 1e-9], [-1e-9, 1.0]], [[1.0, 0.0]], time="discrete")
    assert sampled.status == "observable"


def test_a_singular_value_between_rounding_and_none_is_undecided():
    rng = np.random.default_rng(6)
    n = 6
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    a, c = rng.normal(size=(n, n)), rng.normal(size=(1, n))
    a[:4, 4:] = 0
    c[:, 4:] = 0
    leak, see = rng.normal(size=(4, 2)), rng.normal(size=2)
    for part, status in ((1e-6, "observable"), (3e-13, "undecided"), (0.0, "unobservable")):
        a[:4, 4:] = part * leak
        c[0, 4:] = part * see
        found = gm.linear.unobservable(q @ a @ q.T, c @ q.T)
        assert found.status == status
        assert found.nullity == (0 if status == "observable" else 2)
        # A tolerance that is given is what decides.
        given = gm.linear.unobservable(q @ a @ q.T, c @ q.T, rtol=1e-10)
        assert not given.undecided


def test_observable_pairs_are_not_called_unobservable():
    rng = np.random.default_rng(21)
    called = 0
    for _ in range(60):
        n = int(rng.integers(4, 31))
        a, c = rng.normal(size=(n, n)), rng.normal(size=(int(rng.integers(1, 3)), n))
        away = gm.linear.distance(a, c)
        # Nearly lost: towards the nearest unobservable pair, all but a part of the way.
        v = away.direction
        if abs(away.z.imag) < 1e-9:
            v = v.real / np.linalg.norm(v.real)
            part = 1 - 10.0 ** rng.uniform(-6, 0) / max(away.distance, 1e-300) * 1e-1
            part = min(max(part, 0), 1 - 2e-8 * away.norm / away.distance)
            a = a - part * np.outer((a - away.z.real * np.eye(n)) @ v, v)
            c = c - part * np.outer(c @ v, v)
        if gm.linear.distance(a, c).relative > 1e-8:
            called += gm.linear.unobservable(a, c).nullity
    assert called == 0


def test_integer_matrices_with_a_shift_are_observable():
    """H - 12 I with random integer H: 6 to 17 % were called unobservable."""
    rng = np.random.default_rng(22)
    for n in (14, 20, 24):
        for _ in range(10):
            a = rng.integers(-9, 10, (n, n)).astype(float) - 12 * np.eye(n)
            c = rng.integers(-9, 10, (1, n)).astype(float)
            assert gm.linear.unobservable(a, c).nullity == 0
            assert gm.linear.batch_levels(a, c).rank == n


def test_levels_are_withheld_where_they_cannot_be_told():
    a, c = SYSTEMS["ladder 40"]
    found = gm.linear.levels(a, c)
    assert (found.rank, found.ranks, found.states) == (40, None, None)
    assert "magnify rounding" in found.reason
    with pytest.raises(gm.InputError, match="levels cannot be determined"):
        found.level_of(np.eye(40)[0])
    batch = gm.linear.batch_levels(np.stack([a, np.eye(40, k=1)]), [c, np.eye(40)[:1]])
    assert batch.reliable.tolist() == [False, True]
    assert batch.rank.tolist() == [40, 40]
    assert batch.ranks[0, 0] == -1
    integrators = gm.linear.levels(*SYSTEMS["integrators 20"])
    assert list(integrators.states.values()) == list(range(20))


def test_piecewise_and_problem_take_the_rank_of_the_pencil():
    a, c = pairs(30)
    found = gm.linear.piecewise([a, a], c, [0.1, 0.1])
    assert found.total_ranks == (15, 15)
    assert found.null_space.shape == (30, 15)
    small, row = pairs(6)
    answer = gm.analyze(gm.linear.problem(-small, row, window=5.0, dt=0.1))
    assert answer.nullity == 3


@pytest.mark.parametrize("name", ["ladder 40", "integrators 20"])
def test_certificate(name):
    a, c = SYSTEMS[name]
    found = gm.linear.distance(a, c, certify=True, slack=0.1)
    assert found.complete
    assert 0.9 * found.distance <= found.at_least <= found.distance * (1 + 1e-12)
    # A grid finer than the proof needs finds nothing lower.
    rng = np.random.default_rng(3)
    pencil = _core.LinearPencil(a, c)
    values = [pencil.sigma(*z) for z in rng.uniform([-5, -3], [45, 3], (300, 2))]
    assert min(values) >= found.at_least


def test_a_proof_that_was_cut_short_says_so():
    found = gm.linear.distance(*SYSTEMS["ladder 40"], certify=True, most=50)
    assert not found.complete
    assert "proved so far" in found.summary()


def test_scalings():
    rng = np.random.default_rng(4)
    a, c = rng.normal(size=(5, 5)), rng.normal(size=(1, 5))
    d = 2.0 ** rng.integers(-20, 20, 5)
    one = gm.linear.distance(a, c, scaling="balanced")
    other = gm.linear.distance(a * d / d[:, None] * 8.0, c * d, scaling="balanced")
    # The same but for the rounding of the units to powers of two.
    assert 0.5 < one.distance / other.distance < 2.0
    prior = gm.linear.distance(a, c, scaling="prior", prior=np.ones(5))
    scaled = gm.linear.distance(a * d / d[:, None], c * d, scaling="prior", prior=1 / d)
    assert abs(prior.distance / scaled.distance - 1) < 1e-9


def test_objects_of_scipy_and_control():
    control = pytest.importorskip("control")
    a, c = np.diag([0.5, 0.5]), [[1.0, 1.0]]
    b, d = [[0.0], [1.0]], [[0.0]]
    for system in (scipy.signal.StateSpace(a, b, c, d), control.StateSpace(a, b, c, d)):
        assert not gm.linear.unobservable(system).detectable
        assert gm.linear.distance(system).distance < 1e-15
    sampled = control.StateSpace(a, b, c, d, 0.1)
    assert gm.linear.unobservable(sampled).detectable


BAD = [
    (lambda: gm.linear.distance(np.eye(2), [[1, 0]], scaling="best"), "scaling = 'best'"),
    (lambda: gm.linear.distance(np.eye(2), [[1, 0]], scaling="prior"), "prior is missing for x0"),
    (lambda: gm.linear.distance(np.eye(2), [[1, 0]], certify=True, slack=0.0), "slack = 0"),
    (lambda: gm.linear.distance(np.eye(2), [[1, 0]], certify=True, most=0), "most = 0"),
    (lambda: gm.linear.distance(np.eye(2), [[1, np.inf]]), r"C\[0, 1\] = inf"),
    (lambda: gm.linear.distance(np.full((3, 3), 1e308), [[1, 0, 0]]), "norm of A and C"),
    (lambda: gm.linear.unobservable(np.zeros((2, 3)), [[1, 0]]), "A has shape"),
    (lambda: gm.linear.unobservable(np.eye(2), [[1, 0]], rtol=2.0), "rtol = 2"),
    (lambda: gm.linear.unobservable(np.eye(2), [[1, 0]], time="often"), "time = 'often'"),
    (lambda: gm.linear.unobservable(np.eye(2), [[1, 0]]).left_by([[1, 2, 3]]), "outputs has shape"),
    (lambda: gm.linear.unobservable(np.eye(2), [[1, 0]]).left_by({"a": {"z": 1}}), "named 'z'"),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()


def jordan(eigenvalues, sizes):
    blocks = [
        value * np.eye(size) + np.eye(size, k=1)
        for value, size in zip(eigenvalues, sizes, strict=True)
    ]
    return scipy.linalg.block_diag(*blocks)


def rank_of_powers(a, c):
    """The exact rank of [C; CA; ..] of integers."""
    a, block = a.astype(int).astype(object), c.astype(int).astype(object)
    rows = []
    for _ in range(len(a)):
        rows += block.tolist()
        block = block @ a
    return exact_rank(rows)


@pytest.mark.parametrize("kind", ["integer", "units", "orthogonal"])
def test_chains_of_generalised_eigenvectors_are_found_whole(kind):
    """Rounding spreads an eigenvalue of a chain of k to a ring of radius eps^(1/k)."""
    rng = np.random.default_rng(24)
    wrong = []
    for _ in range(80):
        sizes = rng.integers(1, 5, rng.integers(1, 4))
        a = jordan(rng.integers(-2, 3, len(sizes)), sizes)
        n = len(a)
        c = rng.integers(-1, 2, (int(rng.integers(1, 3)), n)).astype(float)
        if n > 1 and rng.random() < 0.5:
            t, inverse = unimodular(rng, n)
            a, c = t @ a @ inverse, c @ inverse
        rank = rank_of_powers(a, c)
        if kind == "units":
            d = 2.0 ** rng.integers(-20, 21, n)
            a, c = a * d / d[:, None] * 2.0**-40, c * d
        elif kind == "orthogonal":
            q, _ = np.linalg.qr(rng.normal(size=(n, n)))
            a, c = q @ a @ q.T, c @ q.T
        found = gm.linear.unobservable(a, c).rank, gm.linear.levels(a, c).rank
        if found != (rank, rank):
            wrong.append((n, rank, found))
    assert wrong == []


@pytest.mark.parametrize("hidden", [1, 3, 4])
def test_all_but_the_seen_end_of_a_chain_is_hidden(hidden):
    rng = np.random.default_rng(25)
    for _ in range(20):
        q, _ = np.linalg.qr(rng.normal(size=(5, 5)))
        a, c = q @ jordan([-2], [5]) @ q.T, np.eye(5)[[hidden]] @ q.T
        found = gm.linear.unobservable(a, c)
        assert found.nullity == hidden
        assert [mode.motion for mode in found.modes] == ["decays with time constant 0.5"]


@pytest.mark.parametrize("sizes", [[1], [2], [3], [1, 1]])
@pytest.mark.parametrize("time", ["continuous", "discrete"])
def test_a_hidden_bias_never_decays_by_rounding(sizes, time):
    """An integrator is not detectable in any coordinates, and no sign of 1e-17 makes it so."""
    rng = np.random.default_rng(26)
    m, value = sum(sizes), 0.0 if time == "continuous" else 1.0
    for _ in range(12):
        a = np.zeros((m + 3, m + 3))
        a[:3, :3], a[3:, :3] = rng.normal(size=(3, 3)), rng.normal(size=(m, 3))
        a[3:, 3:] = jordan([value] * len(sizes), sizes)
        c = np.hstack([rng.normal(size=(1, 3)), np.zeros((1, m))])
        q, _ = np.linalg.qr(rng.normal(size=(m + 3, m + 3)))
        found = gm.linear.unobservable(q @ a @ q.T, c @ q.T, time=time)
        assert found.nullity == m
        assert not found.detectable
        assert {mode.motion for mode in found.modes} == {"constant"}


def test_an_undamped_motion_has_no_damping_and_does_not_decay():
    rng = np.random.default_rng(27)
    a = scipy.linalg.block_diag(-1.0, [[0, 1], [-4, 0]])
    for _ in range(10):
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        found = gm.linear.unobservable(q @ a @ q.T, [[1, 0, 0]] @ q.T)
        assert [mode.motion for mode in found.modes] == ["oscillates with period 3.142, damping 0"]
        assert not found.detectable


def test_distance_far_from_normal():
    """The nearest point may lie far from all eigenvalues, anywhere in the field of values."""
    rng = np.random.default_rng(28)
    for k in range(40):
        n = int(rng.integers(3, 9))
        a = np.diag(rng.normal(size=n)) + 5 * np.eye(n, k=1)
        if k % 2:
            a = 10 * np.triu(rng.normal(size=(n, n)))
        c = rng.normal(size=(1, n))
        found = gm.linear.distance(a, c).distance
        x, y = np.linalg.eigvalsh((a + a.T) / 2), np.abs(np.linalg.eigvals((a - a.T) / 2)).max()
        grid = np.linspace(x[0], x[-1], 40)[:, None] + 1j * np.linspace(0, y, 30)
        stacks = [np.vstack([a - z * np.eye(n), c]) for z in grid.ravel()]
        assert found <= np.linalg.svd(stacks, compute_uv=False)[:, -1].min() * (1 + 1e-12)


def test_distance_of_nothing_and_of_tiny_numbers():
    nothing = gm.linear.distance(np.zeros((2, 2)), np.zeros((1, 2)), certify=True)
    assert (nothing.distance, nothing.at_least, nothing.complete) == (0.0, 0.0, True)
    a, c = np.diag([1.0, 2.0]), np.ones((1, 2))
    expected = gm.linear.distance(a, c)
    for unit in (1e-300, 1e-160, 1e160, 1e250):
        found = gm.linear.distance(unit * a, unit * c)
        assert abs(found.distance / unit / expected.distance - 1) < 1e-9
        assert abs(found.relative / expected.relative - 1) < 1e-9


@pytest.mark.parametrize(("seed", "n"), [(2729, 19), (3927, 17), (1, 11), (2, 40), (3, 60)])
def test_the_distance_exceeds_the_smallest_singular_value_at_no_eigenvalue(seed, n):
    """A real eigenvalue that rounding put below the axis was not looked at: 1e-4 for 1e-11."""
    rng = np.random.default_rng(seed)
    a, c, v = rng.normal(size=(n, n)), rng.normal(size=(1, n)), rng.normal(size=n)
    v /= np.linalg.norm(v)
    # Hardly seen at a real eigenvalue.
    a -= np.outer((a - 3.0 * np.eye(n)) @ v, v)
    c -= (1 - 1e-8) * np.outer(c @ v, v)
    there = np.linalg.svd(np.concatenate([a - 3.0 * np.eye(n), c]), compute_uv=False)[-1]
    assert gm.linear.distance(a, c).distance <= 1.0001 * there
