"""Reproductions: every claim is a comparison; a model broken on purpose changes the verdict."""

import json

import numpy as np
import pytest

from gramian.models import bearings, dipole, inertial, maneuver
from gramian.models import registration as reg
from gramian.reproduce import PAPERS, dai_2020, reproduce
from gramian.reproduce._claims import fitted, near, refuted, rounded, true, verdict

#: What each paper comes to: comparisons that hold, misprints, refuted, fitted.
WANTED = {
    "dai-2020": (38, 0, 1, 0),
    "li-sheng-2009": (20, 1, 0, 0),
    "yang-yin-2012": (134, 8, 3, 1),
    "zhu-2013": (10, 0, 5, 0),
    "xu-2009": (76, 4, 3, 1),
}


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Keep the evolution short, and the runs few."""
    run = dai_2020.run
    monkeypatch.setattr(dai_2020, "run", lambda: run(generations=60))


@pytest.mark.parametrize("paper", sorted(PAPERS))
def test_every_claim_is_accounted_for(paper):
    report = reproduce(paper)
    assert report.headline.startswith("REPRODUCED")
    outcomes = [claim["outcome"] for claim in report.data["claims"]]
    found = tuple(outcomes.count(kind) for kind in ("holds", "misprint", "refuted", "fitted"))
    assert found == WANTED[paper]
    assert sum(found) == len(outcomes)
    counted = len(outcomes) - outcomes.count("fitted")
    assert f"of {counted} comparisons hold" in report.verdict
    for claim in report.data["claims"]:
        assert claim["outcome"] == "holds" or claim["note"]
    assert json.loads(report.to_json())["headline"] == report.headline


def scaled(result, factor):
    """Return the answer of dipole.localize with its pass stretched."""
    from dataclasses import replace

    return replace(result, r0=factor * result.r0, v=factor * result.v, m=factor * result.m)


def steeper(law):
    return lambda *args, **options: maneuver_heading(*args, **options) + 0.01


maneuver_heading = maneuver.heading
maneuver_trajectory = maneuver.trajectory
localize = dipole.localize
static_base = inertial.static_base
discriminant = bearings.discriminant
rows = bearings.rows
equivalents = dipole.equivalents
dipole_rows = dipole.rows

BROKEN = {
    "static_base at 45 deg": ("yang-yin-2012", inertial, "static_base",
        lambda latitude, *args, **options: static_base(np.radians(45.0), *args, **options)),
    "localize times 1.5": ("dai-2020", dipole, "localize",
        lambda *args, **options: scaled(localize(*args, **options), 1.5)),
    "the dipole's rows": ("dai-2020", dipole, "rows",
        lambda *args: 1.001 * dipole_rows(*args)),
    "the family of u": ("dai-2020", dipole, "equivalents",
        lambda *args: {"same": [x * k for x, k in zip(
            equivalents(*args)["same"], (1.0, 1.0, 1.01), strict=True)]}),
    "a ramp for the degree": ("zhu-2013", reg, "degree",
        lambda path, *args, **options: np.broadcast_to(
            np.arange(path.shape[-2] - 1.0), (*path.shape[:-2], path.shape[-2] - 1))),
    "a heading off by 0.01 rad": ("xu-2009", maneuver, "heading", steeper("max_det")),
    "a path of another law": ("xu-2009", maneuver, "trajectory",
        lambda *args, **options: maneuver_trajectory(*args, **(options | {"law": "circle"}))),
    "the chord for the tangent": ("xu-2009", maneuver, "heading",
        lambda *args: maneuver_heading(
            *(("circle" if isinstance(x, str) and x == "bearing_rate" else x) for x in args))),
    "a discriminant off by 1e-6": ("li-sheng-2009", bearings, "discriminant",
        lambda *args, **options: (1 + 1e-6) * discriminant(*args, **options)),
    "rows of the other side": ("li-sheng-2009", bearings, "rows",
        lambda *args, **options: rows(*args, **options) * [1, -1, 1, -1]),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_model_is_seen(monkeypatch, name):
    paper, module, function, broken = BROKEN[name]
    monkeypatch.setattr(module, function, broken)
    report = reproduce(paper)
    assert report.headline == "NOT REPRODUCED"
    assert report.tone == "bad"
    assert "fail" in report.verdict
    assert any(claim["outcome"] == "FAILS" for claim in report.data["claims"])


@pytest.mark.parametrize(
    ("claim", "outcome"),
    [
        (near("x", 1.0, 1.0 + 1e-10), "holds"),
        (near("x", 1.0, 1.1), "FAILS"),
        (near("x", 1.0, np.nan), "FAILS"),
        (near("x", 1.0, 2.0, right=2.0, note="n"), "misprint"),
        (near("x", 1.0, 3.0, right=2.0, note="n"), "FAILS"),
        (near("x", 2.0, 2.0, right=2.0, note="n"), "FAILS"),
        (rounded("x", "0.12", 0.1249, ".2f"), "holds"),
        (rounded("x", "0.12", 0.1251, ".2f"), "FAILS"),
        (rounded("x", "0.12", 0.1251, ".2f", right="0.13"), "misprint"),
        (rounded("x", "0.12", 0.1, ".2f", right="0.13"), "FAILS"),
        (rounded("x", "0.12", 0.1249, ".2f", right="0.13"), "FAILS"),
        (true("x", True, ""), "holds"),
        (true("x", False, ""), "FAILS"),
        (refuted("x", True, "", ""), "refuted"),
        (refuted("x", False, "", ""), "FAILS"),
    ],
)
def test_comparisons_can_fail(claim, outcome):
    assert claim.outcome == outcome


def test_one_failure_is_the_verdict():
    good = [true("a", True, ""), fitted("b", "1", "1", "to the print")]
    assert verdict(good)[:2] == ("good", "REPRODUCED")
    assert "1 of 1 comparisons hold" in verdict(good)[2]
    tone, headline, sentence = verdict([*good, true("c", False, "")])
    assert (tone, headline) == ("bad", "NOT REPRODUCED")
    assert sentence == "1 of 2 comparisons fail: c"


@pytest.mark.parametrize("paper", sorted(PAPERS))
def test_figures_draw(paper):
    report = reproduce(paper)
    for picture in report.pictures:
        assert picture.draw().axes
    if paper == "xu-2009":
        titles = " ".join(picture.title for picture in report.pictures)
        assert all(str(number) in titles for number in range(1, 13))
