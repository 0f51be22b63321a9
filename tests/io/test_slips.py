"""Slips that people make with files: each ends in a question or an error."""

from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian import io
from gramian.scenario import load


def write(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def table(header, *rows):
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


T = np.arange(8) * 60.0
NORTH = [(t, 0.0, 5.0 * t) for t in T]

#: What was done wrong, the file, and what is asked.
SLIPS = [
    ("latitudes in the metre columns",
     table("t,x,y", *((t, 1.1, 50 + 4.5e-5 * t) for t in T)),
     "are these longitudes and latitudes in degrees"),
    ("milliseconds called seconds",
     table("t,x,y", *((t / 1000, 0, 5 * t) for t in T)), "milliseconds or minutes"),
    ("kilometres in a column of metres beside a speed",
     table("t,x,y,speed", *((t, 0, 0.005 * t, 5) for t in T)), "in degrees .* or kilometres"),
    ("knots called m/s by a factor of ten",
     table("t,x,y,speed", *((t, 0, 5 * t, 50) for t in T)), "is a unit wrong"),
    ("east and north swapped",
     table("t,x,y,course", *((t, 5 * t, t, 11.3) for t in T)), "are the columns swapped"),
    ("course in radians",
     table("t,x,y,course", *((t, -5 * t, 0, 4.71) for t in T)), "off its column of course"),
    ("-999 for a missing position",
     table("t,x,y", *NORTH, (480, -999, -999)), "stand for a missing position"),
    ("latitude 0, longitude 0 for a missing position",
     table("t,lat,lon", *((t, 50, -1 + 1e-4 * t) for t in T), (480, 0, 0)),
     "missing position|too far"),
    ("latitude and longitude swapped",
     table("t,lat,lon", *((t, 151, -33) for t in T)), "swapped"),
    ("radians in bearing_deg",
     table("t,bearing_deg", *((t, 0.3 + 0.01 * t) for t in T)), "are they radians"),
    ("spreadsheet days",
     table("t,x,y", *((46143.5 + t / 86400, 0, 5 * t) for t in T)), "spreadsheet"),
    ("decimal commas with commas between cells",
     "t,x,y\n0,0,0\n1,5,0,0\n", "decimal commas"),
    ("clock times and seconds mixed",
     "t,x,y\n0,0,0\n00:01:00,0,1\n", "must be a number of seconds"),
    ("zones on some times only",
     "t,x,y\n2026-05-01T12:00:00,0,0\n2026-05-01T12:01:00Z,0,1\n", "give all of them one"),
    ("one ship at two places",
     "t,x,y\n0,0,0\n0,5,0\n", "two places"),
    ("thousands separators",
     "t;x;y\n0;1_000;0\n", "must be a number"),
    ("degrees beyond the circle",
     ";SENSOR:\t260501\t120000\tA\t@A\tNULL\t700\t1\ts\n", "within \\+-360"),
    ("a header is missing", "0,0,0\n60,0,300\n", "header"),
    ("day or month first", "t,x,y\n01/05/2026,0,0\n02/05/2026,0,9e4\n", "is the day or the month"),
    ("commas that group thousands", "t;x;y\n1;1,000;2,500\n2;1,100;2,600\n", "group thousands"),
    ("points that group thousands", "t;x;y\n1;0,5;2.500\n2;0,6;2.600\n", "group thousands"),
    ("degrees and minutes in one number", "t,lat,lon\n0,5046.5,106\n9,5046.6,106\n",
     "Write 50 46.5"),
    ("days of MATLAB", "t,x,y\n738642.5,0,1\n738642.6,50,3\n", "day numbers"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "question"), [s[1:] for s in SLIPS], ids=[s[0] for s in SLIPS])
def test_slip_is_asked_about(tmp_path, text, question):
    with pytest.raises(gm.InputError, match=question):
        io.read(write(tmp_path, "file.csv", text))


PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "files.md").read_text(encoding="utf-8")


def test_the_page_lists_them():
    listed = [line[2:].split(":")[0] for line in PAGE.splitlines() if line.startswith("- ")]
    assert {name for name, _, _ in SLIPS} <= set(listed)
    assert len(listed) >= 20


def test_degrees_for_the_radians_of_a_sigma(tmp_path):
    path = write(
        tmp_path,
        "a.toml",
        """
model = "tracks"
[[sensors]]
kind = "bearing"
times = [0, 10]
sigma = 0.5
""",
    )
    with pytest.raises(
        gm.ScenarioError, match=r"sigma = 0.5 rad of a bearing is 29 deg: are these"
    ):
        load(path)


def test_files_that_are_right_are_not_asked_about(tmp_path):
    io.read(write(tmp_path, "a.csv", table("t,x,y,speed", *((t, 0, 5 * t, 5) for t in T))))
    io.read(write(tmp_path, "b.csv", table("t,x,y", *((t, 100.0, 50.0) for t in T))))
    io.read(write(tmp_path, "c.csv", table("t,bearing_deg", *((t, 3 + 0.1 * t) for t in T))))
    io.read(write(tmp_path, "d.csv", table("t,x,y,course", *((t, 0, -5 * t, 180) for t in T))))


def test_a_question_is_answered_by_trust(tmp_path):
    path = write(tmp_path, "a.csv", table("t,bearing_deg", *((t, 0.3 + 0.01 * t) for t in T)))
    with pytest.raises(gm.InputError, match=r"trust = \['bearings'\]"):
        io.read(path)
    seen = io.read(path, trust=["bearings"]).sensors["a"]
    assert np.degrees(seen.bearing[0]) == pytest.approx(0.3)
    with pytest.raises(gm.InputError, match="'all' is no check"):
        io.read(path, trust=["all"])


def test_files_whose_clocks_differ(tmp_path):
    ship = write(tmp_path, "ship.csv", table(
        "time,x,y", *((f"2026-05-01T12:{i:02d}:00Z", 0, 300 * i) for i in range(8))))  # fmt: skip
    seen = write(tmp_path, "seen.csv", table(
        "time,bearing_deg", *((f"2026-05-01T14:{i:02d}:00Z", 10 * i) for i in range(8))))  # fmt: skip
    with pytest.raises(
        gm.InputError, match="With -2 hours they overlap: is one of the files in local"
    ):
        io.read(ship, seen)
    plain = write(tmp_path, "plain.csv", table("t,bearing_deg", *((t, t) for t in T)))
    with pytest.raises(gm.InputError, match="which date is second 0"):
        io.read(ship, plain)
    with pytest.raises(gm.InputError, match="another of the files"):
        io.read(ship, ship)


def encounter(folder, change):
    """Two ships' tracks, and bearings from one to the other, changed."""
    t = np.arange(0.0, 1800.0, 20.0)
    own = np.stack([4 * t, 1500 * np.sin(t / 400)], axis=1)
    other = np.array([6000.0, 4000.0]) + t[:, None] * [-5.0, 1.0]
    ships = write(folder, "ships.csv", table(
        "id,t,x,y", *(("own", a, *p) for a, p in zip(t, own, strict=True)),
        *(("other", a, *p) for a, p in zip(t, other, strict=True))))  # fmt: skip
    course = np.arctan2(*np.gradient(own, axis=0).T)
    s = np.arange(100.0, 1600.0, 20.0)
    at = [np.stack([np.interp(s, t, p[:, k]) for k in (0, 1)], axis=1) for p in (own, other)]
    bearing = np.arctan2(*(at[1] - at[0]).T) + np.random.default_rng(1).normal(0, 0.005, s.size)
    times, angle = change(s, bearing, np.interp(s, t, np.unwrap(course)))
    rows = zip(times, ["own"] * s.size, np.degrees(angle) % 360, strict=True)
    return ships, write(folder, "seen.csv", table("t,id,bearing", *rows))


@pytest.mark.parametrize(
    ("change", "question"),
    [
        (lambda t, b, _: (t - 130, b), r"agree with \+130 s on the sensor's clock"),
        (lambda t, b, _: (t + 3600, b), "they do not overlap. With -1 hour they overlap"),
        (lambda t, b, _: (t, np.pi / 2 - b), "counted counterclockwise from east"),
        (lambda t, b, _: (t, -b), "counted the other way round"),
        (lambda t, b, _: (t, b + np.pi), "from the target to the observer"),
        (lambda t, b, c: (t, b - c), "relative to the carrier's course"),
    ],
    ids=["clock", "zone", "axis", "sense", "reciprocal", "relative"],
)
def test_bearings_that_fit_when_read_in_another_way(tmp_path, change, question):
    files = encounter(tmp_path, change)
    with pytest.raises(gm.InputError, match=question):
        io.read(*files)


def test_bearings_that_fit_are_not_asked_about(tmp_path):
    files = encounter(tmp_path, lambda t, b, _: (t, b))
    assert io.read(*files).sensors["seen"].times.size == 75
    noise = np.random.default_rng(2).uniform(0, 2 * np.pi, 75)
    files = encounter(tmp_path, lambda t, b, _: (t, noise))
    io.read(*files)  # wrong altogether: what a fit says, and no slip that is known
