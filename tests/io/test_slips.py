"""Slips that people make with files: each ends in a question or an error."""

import numpy as np
import pytest

import gramian as gm
from gramian import io


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
]  # fmt: skip


@pytest.mark.parametrize(("text", "question"), [s[1:] for s in SLIPS], ids=[s[0] for s in SLIPS])
def test_slip_is_asked_about(tmp_path, text, question):
    with pytest.raises(gm.InputError, match=question):
        io.read(write(tmp_path, "file.csv", text))


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
