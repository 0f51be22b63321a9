"""Registration: values to 40 digits, and identities that hold everywhere."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm
from gramian import registration as reg

REFERENCE = json.loads(
    (Path(__file__).parents[1] / "reference" / "registration.json").read_text(encoding="utf-8")
)
SENSORS = {"A": (0.0, 0.0), "B": (60e3, 0.0)}
SIGMA = (50.0, np.radians(0.1))
S = np.array([*SIGMA, *SIGMA])
TO_DEGREES = np.array([1, 180 / np.pi, 1, 180 / np.pi])
G1 = 1e3 * np.array(REFERENCE["G1"]["p_km"])
K = np.arange(481.0)
MOTION_1 = np.stack([-30e3 + 250 * K, 40e3 + 0 * K], axis=1)
TARGET_A = np.stack([-20e3 + 400 * K[:200], 25e3 + 0 * K[:200]], axis=1)


def close(value, reference):
    assert value == pytest.approx(reference, rel=1e-9)


def whitened(positions):
    return reg.fisher(positions, SENSORS, SIGMA) * np.outer(S, S)


def test_two_instants():
    ref = REFERENCE["G1"]
    close(reg.degree(G1, SENSORS, SIGMA, method="paper")[0], ref["det_M"])
    close(reg.degree(G1, SENSORS, SIGMA, method="pair")[0], ref["pair_degree"])
    close(float(reg.eta(G1, SENSORS, SIGMA)), ref["eta"])
    close(reg.degree(G1, SENSORS, SIGMA)[-1], ref["eta"])
    close(gm.crlb_std(reg.problem(G1, SENSORS, SIGMA)) * TO_DEGREES, ref["crlb_m_deg"])


def test_the_rows_are_the_papers_matrix_whitened():
    ref = REFERENCE["G1"]
    stacked, det_r = [], []
    for x, y in G1:
        u = []
        for s in SENSORS.values():
            east, north = x - s[0], y - s[1]
            r = np.hypot(east, north)
            u.append((np.array([east, north]) / r, np.array([north, -east])))
        h = np.stack([u[0][0], u[0][1], -u[1][0], -u[1][1]], axis=1)
        noise = h @ np.diag(S**2) @ h.T
        det_r.append(np.linalg.det(noise))
        stacked.append((h, noise))
    close(det_r, ref["det_R"])
    paper = np.vstack([h for h, _ in stacked])
    close(np.linalg.svd(paper, compute_uv=False), ref["singular_values_M"])
    information = sum(h.T @ np.linalg.inv(noise) @ h for h, noise in stacked)
    rows = reg.rows(G1, SENSORS, SIGMA)
    close(rows.T @ rows * np.outer(S, S), information * np.outer(S, S))
    close(reg.fisher(G1, SENSORS, SIGMA) * np.outer(S, S), information * np.outer(S, S))


def test_tracks():
    for positions, ref in ((MOTION_1, REFERENCE["motion_1"]), (TARGET_A, REFERENCE["target_A"])):
        information = whitened(positions)
        close(np.linalg.slogdet(information)[1], ref["whitened_logdet"])
        close(np.linalg.eigvalsh(information)[0], ref["lambda_min"])
        bounds = gm.crlb_std(reg.problem(positions, SENSORS, SIGMA)) * TO_DEGREES
        close(bounds[: len(ref["crlb_m_deg"])], ref["crlb_m_deg"])
    close(bounds, REFERENCE["target_A"]["crlb_m_deg"])
    close(float(reg.eta(TARGET_A, SENSORS, SIGMA)), REFERENCE["target_A"]["eta"])
    adjacent = reg.degree(MOTION_1, SENSORS, SIGMA, method="paper")
    close(adjacent[0], REFERENCE["motion_1"]["adjacent_det_t0"])
    # Motion 1 is symmetric about the bisector, where the degree is least.
    assert adjacent == pytest.approx(adjacent[::-1], rel=1e-6)
    assert adjacent.argmin() in (239, 240)


def test_least_squares_without_noise():
    biases = dict(zip(reg.problem(G1, SENSORS, SIGMA).names, [300, 0.5, -200, -0.4], strict=True))
    biases = {k: np.radians(v) if "azimuth" in k else v for k, v in biases.items()}
    quiet = reg.simulate(TARGET_A, SENSORS, (1e-12, 1e-18), biases, seed=0)
    answer = reg.estimate(quiet, SENSORS, SIGMA, method="ls")
    close(answer.biases * TO_DEGREES, REFERENCE["target_A_one_shot_LS_m_deg"])


def test_the_field_of_a_disc():
    ref = REFERENCE["disc_at_30_40_km"]
    angle = np.arange(8) * np.pi / 4
    disc = [30e3, 40e3] + 2000 * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    assert np.linalg.slogdet(whitened(disc))[1] == pytest.approx(ref["logdet"], rel=1e-9)
    extent = (30e3, 31e3, 40e3, 41e3)
    field = reg.field(SENSORS, SIGMA, extent, points=2)
    close(field.values[0, 0], ref["eta"])


def test_a_look_is_an_orthogonal_projector_of_rank_two_anywhere():
    random = np.random.default_rng(5)
    for positions in random.uniform(-200e3, 200e3, (300, 1, 2)):
        sensors, sigma = random.uniform(-50e3, 50e3, (2, 2)), random.uniform(0.1, 1, (2, 2))
        sigma[:, 0] *= 100
        sigma[:, 1] *= 0.01
        s = sigma.ravel()
        rows = reg.rows(positions, sensors, sigma) * s
        for p in (
            reg.fisher(positions, sensors, sigma) * np.outer(s, s),
            rows.T @ rows,
        ):
            assert np.abs(p @ p - p).max() < 1e-13
            assert np.abs(p - p.T).max() < 1e-13
            assert abs(np.trace(p) - 2) < 1e-13


@settings(max_examples=60, deadline=None)
@given(
    turn=st.floats(-np.pi, np.pi),
    shift=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
    size=st.floats(1e-2, 1e2),
)
def test_turning_shifting_and_units_change_nothing(turn, shift, size):
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    sensors = np.array(list(SENSORS.values()))

    def moved(points):
        return size * (points @ rotation.T + shift)

    track = MOTION_1[::40]
    sigma = (SIGMA[0] * size, SIGMA[1])
    one = reg.eta(track, sensors, SIGMA)
    other = reg.eta(moved(track), moved(sensors), sigma)
    assert other == pytest.approx(float(one), rel=1e-7)
    bounds = gm.crlb_std(reg.problem(track, sensors, SIGMA))
    there = gm.crlb_std(reg.problem(moved(track), moved(sensors), sigma))
    assert there / [size, 1, size, 1] == pytest.approx(bounds, rel=1e-6)


def test_information_adds_and_a_batch_is_its_trials():
    tracks = np.stack([MOTION_1[:40], MOTION_1[100:140], TARGET_A[:40]])
    together = reg.fisher(tracks.reshape(-1, 2), SENSORS, SIGMA)
    each = reg.fisher(tracks, SENSORS, SIGMA)
    assert each.shape == (3, 4, 4)
    assert each.sum(axis=0) == pytest.approx(together, rel=1e-12)
    for one, track in zip(each, tracks, strict=True):
        assert (one == reg.fisher(track, SENSORS, SIGMA)).all()
    before = gm.set_threads(1)
    alone = reg.rows(np.repeat(tracks, 50, axis=0), SENSORS, SIGMA)
    gm.set_threads(before)
    assert (alone == reg.rows(np.repeat(tracks, 50, axis=0), SENSORS, SIGMA)).all()


def test_rows_are_the_derivative_with_positions_eliminated():
    """Against gm.from_function on reports of all positions and biases together."""
    sensors = {"A": (0.0, 0.0, 0.0), "B": (30e3, 5e3, 200.0), "C": (10e3, -20e3, 50.0)}
    sigma = (30.0, 0.002, 0.003)
    places = np.array([[5e3, 8e3, 3e3], [20e3, 12e3, 5e3], [15e3, -4e3, 8e3]])
    extras = ("gain", "position", "attitude")
    direct = reg.problem(places, sensors, sigma, extras=extras)
    n = direct.n

    def measured(state):
        points = state[n:].reshape(-1, 3)
        return np.array(
            reg.simulate(points, sensors, (1e-200,) * 3, state[:n], seed=0, extras=extras).values
        ).ravel()

    names = [*direct.names, *(f"p{i}" for i in range(9))]
    scale = [*(100.0 if u == "m" else 0.01 for u in direct.units), *([1000.0] * 9)]
    joint = gm.from_function(
        measured, np.concatenate([np.zeros(n), places.ravel()]), np.tile(sigma, 9), names,
        scale=scale,
    )  # fmt: skip
    left = joint.problem().marginalize([f"p{i}" for i in range(9)])
    expected, found = left.rows.T @ left.rows, direct.rows.T @ direct.rows
    size = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert (expected / size) == pytest.approx(found / size, abs=1e-7)


@pytest.mark.parametrize("sigma", [(50.0, 1e-3), (1e-9, 1e-3), (1e-100, 1e-3), (1e-200, 1e-3)])
def test_fisher_is_the_sum_of_the_rows_for_any_deviations(sigma):
    """Squares of their products would vanish."""
    looks = [[1e3, 2e4], [4e4, 1.5e4], [-2e4, 3e4]]
    sensors = [[0.0, 0.0], [60e3, 0.0]]
    rows = reg.rows(looks, sensors, sigma)
    found = reg.fisher(looks, sensors, sigma)
    scale = np.linalg.norm(rows, axis=0)
    wanted = (rows / scale).T @ (rows / scale)
    assert np.allclose(found / scale / scale[:, None], wanted, rtol=0, atol=1e-13)
