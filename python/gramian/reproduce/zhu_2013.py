"""Zhu, Tang & He 2013: observability of sensor biases in the track-independent model.

The text we have lost its formulas and tables, so there is no printed number to
set beside ours: the targets below are of the paper's kind, and what is checked are
its claims on Figures 2 to 9 and Table 2, each by a comparison that can fail.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief
from gramian.analysis import analyze
from gramian.bounds import crlb_std
from gramian.models import registration as reg
from gramian.report import Picture, Report, Table
from gramian.reproduce._claims import Claim, claims_data, claims_table, refuted, true, verdict

__all__ = ["MOTIONS", "TARGETS", "run"]

Array = NDArray[np.float64]

SENSORS = {"A": np.array([0.0, 0.0]), "B": np.array([60e3, 0.0])}
SIGMA = np.array([50.0, np.radians(0.1)])
NAMES = ("A.range", "A.azimuth", "B.range", "B.azimuth")
BIASES = dict(zip(NAMES, (300.0, np.radians(0.5), -200.0, np.radians(-0.4)), strict=True))
RUNS, SEED = 100, 2013

#: Start and velocity of the three targets, 200 looks 1 s apart.
TARGETS = {
    "A": ((-20e3, 25e3), (400.0, 0.0)),
    "B": ((60e3, 60e3), (150.0, 150.0)),
    "C": ((90e3, 100e3), (50.0, 200.0)),
}
#: The paper's three motions and a fourth of ours, abeam sensor A: 481 looks.
MOTIONS = {
    "1: parallel to the baseline": ((-30e3, 40e3), (250.0, 0.0)),
    "2: along the bisector": ((30e3, 60e3), (0.0, -250.0)),
    "3: along the baseline": ((6e3, 0.0), (100.0, 0.0)),
    "4: abeam sensor A (ours)": ((0.0, 120e3), (0.0, -240.0)),
}


def track(start: tuple[float, float], velocity: tuple[float, float], looks: int) -> Array:
    """Return positions (looks, 2) at 1 s."""
    path: Array = np.array(start) + np.arange(looks)[:, None] * np.array(velocity)
    # Motion 4 passes over the sensor itself, where no azimuth exists.
    near = np.min([np.hypot(*(path - s).T) for s in SENSORS.values()], axis=0)
    kept: Array = path[near > 1.0]
    return kept


def printed_degree(reports: Array) -> Array:
    """Return abs(det M) of neighbouring looks, from each sensor's own reports (K, 2, 2).

    The determinant in the paper's variables: ranges, and gamma = theta_A - theta_B.
    """
    ra, rb = reports[:, 0, 0], reports[:, 1, 0]
    gamma = reports[:, 0, 1] - reports[:, 1, 1]
    c, s = np.cos(gamma), np.sin(gamma)
    one = (ra[:-1] * rb[1:] + ra[1:] * rb[:-1]) * (1 - c[:-1] * c[1:])
    two = (ra[:-1] * rb[:-1] + ra[1:] * rb[1:]) * s[:-1] * s[1:]
    degree: Array = np.abs(one - two)
    return degree


def run() -> Report:
    """Compute the paper's comparisons and give a verdict on each claim."""
    targets = {name: track(*motion, 200) for name, motion in TARGETS.items()}
    motions = {name: track(*motion, 481) for name, motion in MOTIONS.items()}
    target_rows, errors = _target_rows(targets)
    motion_rows = []
    for name, path in motions.items():
        answer = analyze(reg.problem(path, SENSORS, SIGMA))
        degree = reg.degree(path, SENSORS, SIGMA, method="paper")
        low, high = degree.min(), degree.max()
        motion_rows.append(
            [
                name, str(answer.rank), f"{brief(low)} at {int(degree.argmin())} s",
                f"{brief(high)} at {int(degree.argmax())} s",
                f"{float(reg.eta(path, SENSORS, SIGMA)):.3f}",
                *(_cell(b, i) for i, b in enumerate(answer.crlb_std[:2])),
            ]
        )  # fmt: skip
    claims = _claims(targets, motions, errors)
    tone, headline, sentence = verdict(claims)
    return Report(
        title="Zhu, Tang & He 2013",
        subtitle="Observability of sensor biases, track-independent model (J. Radars 2(4))",
        tone=tone,
        headline=headline,
        verdict=sentence,
        facts=[
            (
                "parameters",
                "A (0, 0), B (60, 0) km, 50 m, 0.1 deg; the paper does not give its own: no "
                "printed number to compare with",
            )
        ],
        tables=[
            claims_table("The paper's claims", claims),
            Table(
                f"Three targets, {RUNS} runs: RMSE of A.range and A.azimuth",
                ["target", "degree, dB", "eta", "LS", "GLS", "ML", "bound"],
                target_rows,
                "Biases 300 m, 0.5 deg, -200 m, -0.4 deg. LS is the paper's estimator; "
                "degree is the median of 10 log10 abs(det M) between neighbouring looks.",
            ),
            Table(
                "Motions",
                ["motion", "rank", "least degree, m^2", "greatest degree, m^2", "eta",
                 "bound of A.range", "bound of A.azimuth"],
                motion_rows,
            ),
        ],
        pictures=_pictures(targets, motions),
        data={
            "claims": claims_data(claims),
            "targets": errors,
        },
    )  # fmt: skip


def _target_rows(targets: dict[str, Array]) -> tuple[list[list[str]], dict[str, Any]]:
    rows, errors = [], {}
    truth = np.array([BIASES[name] for name in NAMES])
    for name, path in targets.items():
        level = 10 * np.log10(np.median(reg.degree(path, SENSORS, SIGMA, method="paper")))
        bound = crlb_std(reg.problem(path, SENSORS, SIGMA))
        found: dict[str, Any] = {"bound": bound.tolist(), "degree_db": float(level)}
        cells = []
        for method in ("ls", "gls", "ml"):
            answer = reg.estimate_trials(
                path, SENSORS, SIGMA, BIASES, seed=SEED, trials=RUNS, method=method
            )
            rmse = np.sqrt(((answer.biases - truth) ** 2).mean(axis=0))
            found[method] = rmse.tolist()
            cells.append(f"{brief(rmse[0], 4)} m, {brief(np.degrees(rmse[1]))} deg")
        cells.append(f"{brief(bound[0], 4)} m, {brief(np.degrees(bound[1]))} deg")
        eta = float(reg.eta(path, SENSORS, SIGMA))
        rows.append([name, f"{level:.1f}", f"{eta:.3f}", *cells])
        errors[name] = found
    return rows, errors


def _claims(
    targets: dict[str, Array], motions: dict[str, Array], errors: dict[str, Any]
) -> list[Claim]:
    parallel, bisector, baseline, abeam = motions.values()
    one, two, three = (
        reg.degree(path, SENSORS, SIGMA, method="paper") for path in (parallel, bisector, baseline)
    )
    # Reports with biases, and the same without noise or bias for the printed determinant.
    unequal, equal = (printed_degree(_reports(baseline, 0.5, b)) for b in (-0.4, 0.5))
    off = max(_apart(path) for path in (*targets.values(), parallel, bisector))
    on_line = printed_degree(_reports(baseline, 0.0, 0.0, 0.0, 0.0))
    between, beyond, side, usual = (
        analyze(reg.problem(path, SENSORS, SIGMA))
        for path in (baseline, baseline + np.array([60e3, 0.0]), abeam, parallel)
    )
    crossing = int(np.argmin(np.abs(bisector[:, 1])))
    correlation, counter = _trend()
    best = crlb_std(reg.problem(bisector, SENSORS, SIGMA))
    plain = crlb_std(reg.problem(parallel, SENSORS, SIGMA))
    order = [errors[name]["degree_db"] for name in TARGETS]
    fall = [errors[name]["ls"] for name in TARGETS]
    mirrored = float(np.abs(one - one[::-1]).max() / one.max())
    return [
        true("(16): the degree is abs(det M) of two looks, here of the true positions",
             off < 1e-6, f"library and printed form differ by {off:.0e} of the largest"),
        true("singular where the target moves on the line between the sensors",
             between.rank == 3 and usual.rank == 4,
             f"rank {between.rank} of 4: {_null(between)} is not determined"),
        refuted("and nowhere else", beyond.rank < 4 and side.rank < 4,
                f"rank {beyond.rank} beyond a sensor, {side.rank} abeam one",
                f"{_null(beyond)} and {_null(side)} are not determined there"),
        true("Fig. 3: the degree of target A is above B, B above C",
             order[0] > order[1] > order[2], ", ".join(f"{x:.0f}" for x in order) + " dB"),
        true("Table 2: the errors of target A are below those of B, B below C",
             all(fall[0][i] < fall[1][i] < fall[2][i] for i in range(4)),
             "LS errors of A.range " + ", ".join(f"{x[0]:.3g}" for x in fall) + " m"),
        true("Fig. 5, motion 1: the degree is least where the track crosses the bisector",
             int(one.argmin()) in (239, 240),
             f"between looks {int(one.argmin())} and {int(one.argmin()) + 1} of 480"),
        true("Fig. 5, motion 1: symmetric about the bisector", mirrored < 1e-6,
             f"to {mirrored:.0e} of the largest"),
        true("Fig. 7, motion 2: greatest where it crosses the baseline",
             abs(int(two.argmax()) - crossing) <= 1,
             f"at {int(two.argmax())} s; the track is on the baseline at {crossing} s"),
        true("Fig. 7, motion 2: symmetric about the baseline",
             float(np.abs(two - two[::-1]).max() / two.max()) < 1e-6,
             f"to {float(np.abs(two - two[::-1]).max() / two.max()):.0e} of the largest"),
        refuted("motion 2: it is greatest there because of the biases",
                abs(int(two.argmax()) - crossing) <= 1, "greatest there without any bias",
                "the degree above is that of the true positions"),
        true("Fig. 9, motion 3: on the baseline the degree is markedly smaller",
             float(np.median(unequal)) < 1e-2 * float(one.min()),
             f"from reports with biases {np.median(unequal):.3g} m^2, least of motion 1 "
             f"{one.min():.3g} m^2"),
        refuted("Fig. 9, motion 3: with biases it tends to 0 but is not 0",
                float(on_line.max()) < 1e-6 * float(one.min())
                and float(three.max()) < 1e-6 * float(one.min())
                and float(np.median(equal)) < 1e-3 * float(np.median(unequal)),
                f"of the true positions {np.median(three):.2g} m^2, with equal azimuth biases "
                f"{np.median(equal):.2g} m^2",
                "an artefact of biased reports: the rank is 3 all the same"),
        refuted("keep away from the bisector and the baseline, as places",
                best[0] < plain[0] and between.rank < 4,
                f"along the bisector the bound of A.range is {best[0]:.3g} m, of the parallel "
                f"track {plain[0]:.3g} m",
                "only moving along the baseline, or abeam a sensor, is bad"),
        true("the larger the degree, the smaller the error, as a trend", correlation > 0.5,
             f"rank correlation {correlation:.2f} over 2000 tracks"),
        refuted("the larger the degree, the smaller the error, always", counter > 0.01,
                f"in {counter:.0%} of pairs of tracks the order is reversed",
                "the degree leaves out where the information points"),
    ]  # fmt: skip


def _null(answer: Any) -> str:
    return answer.null_combinations[0] if answer.null_combinations else "nothing"


def _apart(path: Array) -> float:
    """Compare the library's degree with the printed form from reports without error."""
    library = reg.degree(path, SENSORS, SIGMA, method="paper")
    printed = printed_degree(_reports(path, 0.0, 0.0, 0.0, 0.0))
    return float(np.abs(library - printed).max() / printed.max())


def _reports(
    path: Array,
    azimuth_a: float,
    azimuth_b: float,
    range_a: float = 300.0,
    range_b: float = -200.0,
) -> Array:
    biases = {"A.range": range_a, "B.range": range_b}
    biases |= {"A.azimuth": np.radians(azimuth_a), "B.azimuth": np.radians(azimuth_b)}
    # Noise far below rounding: the claim is about biases.
    return reg.simulate(path, SENSORS, (1e-12, 1e-18), biases, seed=0).values


def _biased(path: Array) -> tuple[Array, Array]:
    return np.arange(len(path) - 1.0), printed_degree(_reports(path, 0.5, -0.4))


def _trend() -> tuple[float, float]:
    """Rank correlation of degree and bound over random tracks, and pairs out of order."""
    random = np.random.default_rng(SEED)
    start = random.uniform([-60e3, -80e3], [120e3, 80e3], (2000, 2))
    speed, course = random.uniform(100, 400, 2000), random.uniform(0, 2 * np.pi, 2000)
    velocity = speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=1)
    tracks = start[:, None] + np.arange(0, 200.0, 10.0)[:, None] * velocity[:, None]
    degree = np.log(reg.degree(tracks, SENSORS, SIGMA, method="paper").mean(axis=1))
    bound = crlb_std(reg.rows(tracks, SENSORS, SIGMA))
    level = -np.log(bound).mean(axis=1)
    ranks = [np.argsort(np.argsort(x)) for x in (degree, level)]
    correlation = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
    i, j = random.integers(0, 2000, (2, 20000))
    reversed_pairs = (degree[i] - degree[j]) * (level[i] - level[j]) < 0
    return correlation, float(reversed_pairs.mean())


def _cell(value: float, index: int) -> str:
    if np.isinf(value):
        return "not observable"
    return f"{brief(value, 4)} m" if index % 2 == 0 else f"{brief(np.degrees(value), 4)} deg"


def _pictures(targets: dict[str, Array], motions: dict[str, Array]) -> list[Picture]:
    def plot() -> Any:
        from gramian.models.registration import plot as pictures

        return pictures

    def curves(paths: dict[str, Array]) -> dict[str, tuple[Array, Array]]:
        return {
            name: (np.arange(len(path) - 1.0), reg.degree(path, SENSORS, SIGMA, method="paper"))
            for name, path in paths.items()
        }

    return [
        Picture(
            "Targets (the paper's Fig. 2)",
            "Two sensors and three targets. Nothing is determined along the red lines.",
            lambda: plot().geometry(SENSORS, targets),
        ),
        Picture(
            "Degree of the three targets (Fig. 3)",
            "10 log10 abs(det M) of neighbouring looks: A above B above C.",
            lambda: plot().degrees(curves(targets), ylabel="degree, dB", decibels="yes"),
        ),
        Picture(
            "Motions (Figs. 4, 6, 8)",
            "The paper's three motions, and the fourth abeam sensor A.",
            lambda: plot().geometry(SENSORS, motions),
        ),
        Picture(
            "Degree of motions 1 and 2 (Figs. 5, 7)",
            "Motion 1 is lowest on the bisector; motion 2, along the bisector, peaks where it "
            "crosses the baseline. Motions 3 and 4 are 0 throughout.",
            lambda: plot().degrees(
                dict(list(curves(motions).items())[:2]), ylabel="degree, dB", decibels="yes"
            ),
        ),
        Picture(
            "Degree of motion 3 (Fig. 9)",
            "Along the baseline, from reports with biases of 0.5 and -0.4 deg: small, and all of "
            "it from the biases. Without them it is 0.",
            lambda: plot().degrees(
                {"3: along the baseline, biased": _biased(list(motions.values())[2])},
                ylabel="degree, dB",
                decibels="yes",
            ),
        ),
        Picture(
            "Where a place tells the biases",
            "eta of 8 looks on a circle of 2 km: the field that the paper leaves to later work.",
            lambda: reg.field(SENSORS, SIGMA, (-60e3, 120e3, -90e3, 90e3), points=90).plot(),
        ),
    ]
