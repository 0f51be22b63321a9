"""Scenario files, their mistakes, and the command with its exit status."""

import json
import re
import shutil
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian._layout import columns
from gramian.scenario import load

DEMO = Path(str(files("gramian") / "demo"))


@pytest.fixture
def easy(tmp_path):
    """A copy of the easy demo: the text to change, and where to write it."""
    shutil.copy(DEMO / "bay.csv", tmp_path)
    return (DEMO / "1_easy.toml").read_text(), tmp_path / "scenario.toml"


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "gramian", *map(str, arguments)],
        capture_output=True, text=True, check=False, env={"COLUMNS": "200", "PATH": "/usr/bin"},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "status", "headline"),
    [
        ("1_easy", "observable", "OBSERVABLE"),
        ("2_hopeless", "weak", "HOPELESS"),
        ("3_impossible", "unobservable", "UNOBSERVABLE"),
    ],
)
def test_demo_scenarios(name, status, headline, tmp_path):
    report = load(DEMO / f"{name}.toml").analyze()
    assert report.data["observability"]["status"] == status
    assert report.headline == headline
    page, data = report.write(tmp_path)
    text = page.read_text()
    assert headline in text
    assert text.count('<img src="data:image/') == 4
    assert not re.search(r"(src|href)=\"(?!data:)", text), "the page must be self-contained"
    assert json.loads(data.read_text())["headline"] == headline


def test_unobservable_case_prints_no_number_for_it():
    report = load(DEMO / "3_impossible.toml").analyze()
    bounds = report.tables[0].rows
    assert all(row[1] == "not observable" for row in bounds)
    assert report.data["relative_bound"] == "inf"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("bearing_deg = 0.5", "bearing_deg = -0.5", r":16: noise\.bearing_deg = -0\.5: must be > 0"),
        ("bearing_deg = 0.5", 'bearing_deg = "half"', r":16: noise\.bearing_deg = 'half': must be a"),
        ("bearing_deg = 0.5", "bearing_deg = nan", r"noise\.bearing_deg = nan: must be finite"),
        ("step = 15.0", "stride = 15.0", r"window\.stride is not a key"),
        ("step = 15.0", "step = 15.0\nstride = 1.0", r":14: window\.stride is not a key here: the keys are start, duration, step"),
        ("step = 15.0", "step = 1e4", r"step 10000\.0 s must not exceed the duration"),
        ("[noise]", "[nois]", r"nois is not a key here"),
        ('model = "bearings"', 'model = "sonar"', r"model = 'sonar': must be one of \"bearings\""),
        ('model = "bearings"', "", r"model is missing"),
        ('model = "bearings"', "model = ", r"is not valid TOML.*line 2"),
        ('observer = "pilot_boat"', 'observer = "pilot"', r"no track is named 'pilot'.*'freighter'"),
        ('"bay.csv"', '"sea.csv"', r"sea\.csv: cannot be read"),
        ('"east_m"', '"x_m"', r"bay\.csv: has no column 'x_m': its columns are vessel"),
        ("start = 120.0", "start = 900.0", r"reaches beyond the track of pilot_boat"),
        ('target = "freighter"', "", r"give the target once"),
        ("[noise]", "[prior]\nspeed = 0.0\n[noise]", r"prior\.speed.* must be > 0"),
        ("[noise]", "[prior]\ndepth = 1.0\n[noise]", r"prior\.depth"),
    ],
)  # fmt: skip
def test_each_mistake_is_named(easy, old, new, message):
    text, path = easy
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(gm.ScenarioError, match=message) as caught:
        load(path).analyze()
    assert str(path.parent) in str(caught.value)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("freighter,5.0,1.0,oops", r"bay\.csv:\d+: north_m = 'oops': must be a number"),
        ("freighter,5.0,inf,1.0", r"bay\.csv:\d+: east_m = inf: must be finite"),
        ("freighter,5.0,1.0", r"bay\.csv:\d+: has 3 cells: must have 4"),
    ],
)
def test_a_bad_cell_is_named_with_its_line(easy, row, message):
    text, path = easy
    path.write_text(text)
    csv = path.parent / "bay.csv"
    csv.write_text(csv.read_text() + row + "\n")
    with pytest.raises(gm.ScenarioError, match=message):
        load(path).analyze()


def test_a_gap_in_the_reports_is_an_error_unless_allowed(easy):
    text, path = easy
    csv = path.parent / "bay.csv"
    lines = csv.read_text().splitlines()
    kept = [
        line for line in lines
        if not (line.startswith("freighter") and 400 < float(line.split(",")[1]) < 600)
    ]  # fmt: skip
    csv.write_text("\n".join(kept))
    path.write_text(text)
    with pytest.raises(gm.ScenarioError, match=r"freighter has a gap of \d+ s .*max_gap = 120"):
        load(path).analyze()
    path.write_text(text.replace('target = "freighter"', 'target = "freighter"\nmax_gap = 300.0'))
    assert load(path).analyze().data["observability"]["rank"] == 4


def test_known_and_prior_states(easy):
    text, path = easy
    path.write_text('known = ["vx"]\n' + text + "\n[prior]\nspeed = { mean = 4.0, sigma = 0.1 }\n")
    data = load(path).analyze().data["observability"]
    assert data["names"] == ["x0", "y0", "vy"]
    assert data["priors"] == {"speed": 0.1}
    path.write_text('known = ["vx"]\n' + text + "\n[prior]\nvx = 1.0\n")
    with pytest.raises(gm.ScenarioError, match=r"prior\.vx: is a known state"):
        load(path).analyze()


def test_command_exit_status_and_files(easy, tmp_path):
    text, path = easy
    path.write_text(text)
    done = run("analyze", path, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "OBSERVABLE" in done.stdout
    assert (tmp_path / "out" / "report.html").exists()
    data = json.loads((tmp_path / "out" / "result.json").read_text())
    again = json.loads(run("analyze", path, "--json").stdout)
    # The date of the answer apart.
    assert again.pop("origin")["inputs"] == data.pop("origin")["inputs"]
    assert again == data
    path.write_text(text.replace("0.5", "-0.5"))
    wrong = run("analyze", path)
    assert wrong.returncode == 1
    assert "must be > 0" in wrong.stderr
    assert "Traceback" not in wrong.stderr
    assert run("analyze").returncode == 2
    assert run("frobnicate").returncode == 2


def test_command_on_a_folder_it_cannot_write(easy, tmp_path):
    text, path = easy
    path.write_text(text)
    (tmp_path / "file").write_text("")
    done = run("analyze", path, "--out", tmp_path / "file")
    assert done.returncode == 1
    assert "cannot write the report" in done.stderr


def test_demo_command(tmp_path):
    done = run("demo", "--out", tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("report.html") == 3


def test_a_report_has_a_map_of_what_is_asked(tmp_path):
    file = tmp_path / "straight.toml"
    file.write_text(
        'model = "tracks"\n[[carriers]]\nname = "ship"\npath = [[0, 0], [1500, 2000]]\n'
        'times = [0, 900]\n[[sensors]]\nkind = "bearing"\ncarrier = "ship"\n'
        "times = { first = 0, last = 900, step = 15 }\nsigma_deg = 0.5\n"
        "[target]\nx0 = 3000\ny0 = 4200\nvx = -3\nvy = 1.2\n"
    )
    picture = load(file).analyze().pictures[0]
    assert "dashed" in picture.caption
    (axes,) = picture.draw().axes
    ship = np.linspace(0, 1, 200)[:, None] * [1.5, 2.0]
    target = next(line for line in axes.lines if line.get_label() == "target").get_xydata()
    dashed = [line.get_xydata() for line in axes.lines if line.get_linestyle() == "--"]
    assert len(dashed) == 4
    for track in dashed:
        seen, true = (np.arctan2(*(points - ship).T) for points in (track, target))
        np.testing.assert_allclose(seen, true, atol=1e-9)
    # One more leg, and the place has an ellipse.
    file.write_text(file.read_text().replace("[1500, 2000]]", "[1500, 0], [1500, 2000]]")
                    .replace("times = [0, 900]", "times = [0, 450, 900]"))  # fmt: skip
    picture = load(file).analyze().pictures[0]
    assert "ellipses" in picture.caption
    assert "95 % ellipse, first and last" in [x.get_label() for x in picture.draw().axes[0].lines]


def test_no_column_is_wider_than_its_place():
    """Short cells below long heads: the lines keep to the width."""
    names = [f"state{k} then, m/s" for k in range(9)]
    for width in range(20, 90, 7):
        for head, body in columns(["known exactly", *names], [["x", *["0.1"] * 9]] * 2,
                                  [True, *[False] * 9], width):  # fmt: skip
            assert max(map(len, head + body)) <= width
