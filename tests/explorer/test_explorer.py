"""The explorer's page in a browser: its numbers are the library's, and it does what it says.

Skipped where the Rust target wasm32-unknown-unknown, playwright or Chromium is missing;
GRAMIAN_REQUIRE_EXPLORER=1 makes them required.
"""

import itertools
import json
import re
import subprocess
import sys

import numpy as np
import pytest

import gramian as gm
from explorer_page import load_build, settle
from gramian import _core


@pytest.fixture
def page(browser):
    started, address = browser
    yield from opened(started, address, viewport={"width": 1280, "height": 900})


def opened(started, address, **options):
    context = started.new_context(**options)
    page = context.new_page()
    said = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on(
        "request", lambda request: said.append(request.url) if request.url[:4] == "http" else None
    )
    page.goto(address)
    settle(page)
    yield page
    context.close()
    assert said == []  # no error, no warning, nothing loaded


def numbers(page, expression):
    # JSON has no infinity.
    text = page.evaluate(
        f"JSON.stringify({expression}, (k, v) => typeof v === 'number' && !isFinite(v) ? String(v) : v)"
    )
    return np.array(eval_json(text), dtype=float)


def eval_json(text):
    def plain(value):
        if isinstance(value, list):
            return [plain(one) for one in value]
        return float({"Infinity": "inf", "-Infinity": "-inf", "NaN": "nan"}.get(value, value))

    return plain(json.loads(text))


def status(page):
    return page.inner_text("#status").lower()


def example(page, name):
    page.select_option("#control-0", name)
    settle(page)


def code(page, kind):
    page.click(f"#copy-{kind}")
    return page.inner_text("#code")


def run_python(text):
    """Run copied Python and give what it has made."""
    made = {}
    exec(compile(re.sub(r"^print\(", "_ = (", text, flags=re.M), "copied", "exec"), made)
    return made


def tab(page, name):
    page.click(f"#tab-{name}")
    settle(page)


EXAMPLES = (
    "A turn",
    "Straight: unobservable",
    "A slight turn: weak",
    "Straight, speed known",
    "Straight, with ranges",
    "Fixed observer",
)


@pytest.mark.parametrize("name", EXAMPLES)
def test_track_equals_the_library(page, name):
    example(page, name)
    made = run_python(code(page, "python"))
    answer = made["answer"]
    assert status(page) == answer.status
    assert page.inner_text("#reason") == answer.reason
    # Sorted out by rounding alone where the bound is infinite.
    np.testing.assert_allclose(numbers(page, "explorer.answer.bound"), answer.crlb_std, rtol=1e-9)
    np.testing.assert_allclose(numbers(page, "explorer.answer.data"), answer.data_std, rtol=1e-9)
    values = made["scene"].values(made["state"])
    np.testing.assert_allclose(
        numbers(page, "explorer.answer.values"), values, rtol=1e-9, atol=1e-12
    )
    scale = made["problem"].scale
    np.testing.assert_allclose(numbers(page, "explorer.answer.scale"), scale, rtol=1e-12)
    null = numbers(page, "explorer.answer.nullSpace").reshape(-1, 4).T
    np.testing.assert_allclose(null, answer.null_space, rtol=1e-9, atol=1e-12)
    for text in answer.null_combinations:
        assert text in page.inner_text("#facts")


def test_bound_against_time_and_next_heading(page):
    made = run_python(code(page, "python"))
    along = numbers(page, "explorer.answer.along")
    scene, state, times = made["scene"], made["state"], made["times"]
    rows = gm.tracks.rows(scene, state)
    assert np.isinf(along[20]).all()  # before the turn
    for k in (40, 59):
        so_far = _core.Analysis(rows[: k + 1], None)
        for axis in range(2):
            place = np.zeros(4)
            place[axis], place[axis + 2] = 1.0, times[k]
            assert along[k, axis] == pytest.approx(so_far.combination_std(place), rel=1e-9)
    # The best heading: one more leg of a third of the time, 20 bearings, at the same speed.
    headings = numbers(page, "explorer.more.headings")
    end = np.array([1500.0, 2600.0])
    leg = times[-1] / 3
    later = times[-1] + leg * np.arange(1, 21) / 20
    length = np.hypot(1500, 600) + 2000
    for k in (0, 3, 17):
        way = leg * length / times[-1] * np.array([np.sin(k * np.pi / 18), np.cos(k * np.pi / 18)])
        ship = gm.tracks.Carrier([end, end + way], [times[-1], later[-1]])
        sensor = gm.tracks.Sensor.bearing(ship, later, sigma=np.radians(0.5))
        more = gm.tracks.Scene(scene.motion, [sensor], reference=0.0)
        answer = _core.Analysis(np.vstack([rows, gm.tracks.rows(more, state)]), None)
        std = [
            answer.combination_std([1, 0, later[-1], 0]),
            answer.combination_std([0, 1, 0, later[-1]]),
        ]
        assert headings[k] == pytest.approx(np.hypot(*std), rel=1e-9)
    assert f"{10 * int(np.argmin(headings))}°" in page.inner_text("#facts")


def agree(page, found, last):
    """Regions of the first and the last place, and intervals, are those of the estimate."""
    size = page.evaluate("explorer.more.regions.length")
    pairs = [("x0", "y0"), ({"x0": 1, "vx": last}, {"y0": 1, "vy": last})]
    theirs = [curve for pair in pairs for curve in found.region(pair).contours]
    assert size == len(theirs) >= 2
    for k, curve in enumerate(theirs):
        ours = numbers(page, f"explorer.more.regions[{k}].points")
        # The same steps of the same function, from the same state to a few roundings.
        assert ours.shape == curve.shape
        np.testing.assert_allclose(ours, curve, atol=1e-6 * np.ptp(curve, axis=0).max())
    for k, name in enumerate(found.names):
        ours = numbers(page, f"explorer.more.intervals[{k}]").reshape(-1, 2)
        pieces = [[-np.inf if low is None else low, np.inf if high is None else high]
                  for low, high in found.interval(name).pieces]  # fmt: skip
        np.testing.assert_allclose(ours, pieces, rtol=1e-6)
    assert page.evaluate("explorer.problems").__len__() == 0


@pytest.mark.parametrize("name", ["A turn", "Straight, with ranges", "A slight turn: weak"])
def test_regions_and_intervals_are_the_librarys(page, name):
    example(page, name)
    made = run_python(code(page, "python"))
    scene, state = made["scene"], np.array(list(made["state"].values()))
    found = gm.tracks.estimate(scene, scene.values(state), start=state)
    agree(page, found, float(made["times"][-1]))


ROUGH = """() => {
  const { track } = explorer.models, scene = explorer.scenes.track, a = explorer.answer;
  const all = (asked) => Object.fromEntries(Object.entries(asked).map(([k, one]) => [k, explorer.ask(...one)]));
  return track.gather(scene, a, all(track.soon(scene, a))).regions.map(({ points }) => points);
}"""


@pytest.mark.parametrize("name", ["A turn", "Straight, with ranges"])
def test_regions_of_a_drag_are_those_at_rest_but_rougher(page, name):
    example(page, name)
    rough = page.evaluate(ROUGH)
    fine = page.evaluate("explorer.more.regions.map(({ points }) => points)")
    assert len(rough) == len(fine) == 2
    for some, curve in zip(map(np.array, rough), map(np.array, fine), strict=True):
        assert 8 < len(some) < len(curve)
        size = np.ptp(curve, axis=0).max()
        line = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(curve)])
        apart = np.linalg.norm(some[:, None] - line, axis=2).min(axis=1)
        assert apart.max() < 0.01 * size


def test_null_tracks_fit(page):
    example(page, "Straight: unobservable")
    made = run_python(code(page, "python"))
    exact = made["scene"].values(made["state"])
    states = numbers(page, "explorer.more.tracks.map((t) => t.state)")
    assert len(states) == 8
    for state in states:
        np.testing.assert_allclose(made["scene"].values(state), exact, atol=1e-9)
    assert "exactly the same measurements" in page.inner_text("#facts")


def test_dragging_changes_the_verdict(page):
    example(page, "Straight: unobservable")
    assert status(page) == "unobservable"
    page.click("text=Add waypoint")
    settle(page)
    assert status(page) == "observable"
    page.click("text=Remove waypoint")
    settle(page)
    before = page.evaluate("explorer.scenes.track.target.slice()")
    target = page.locator('[data-name="target at the first measurement"]').bounding_box()
    x, y = target["x"] + target["width"] / 2, target["y"] + target["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 40, steps=5)
    page.mouse.up()
    settle(page)
    assert page.evaluate("explorer.scenes.track.target[0]") > before[0]
    # A waypoint is dragged out of line: the middle one of a straight path.
    page.evaluate(
        "() => { explorer.scenes.track.path.splice(1, 0, [750, 1000]); explorer.update(); }"
    )
    settle(page)
    assert status(page) == "unobservable"
    middle = page.locator('[data-name="observer waypoint 2"]').bounding_box()
    x, y = middle["x"] + middle["width"] / 2, middle["y"] + middle["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y + 10, steps=8)
    page.mouse.up()
    settle(page)
    assert status(page) == "observable"


def test_keyboard(page):
    example(page, "Straight: unobservable")
    page.evaluate(
        "() => { explorer.scenes.track.path.splice(1, 0, [750, 1000]); explorer.update({controls: true}); }"
    )
    page.locator('[data-name="observer waypoint 2"]').focus()
    for _ in range(8):
        page.keyboard.press("Shift+ArrowRight")
    settle(page)
    assert status(page) == "observable"
    page.keyboard.press("Delete")
    settle(page)
    assert status(page) == "unobservable"


def test_link_carries_the_scene(browser, page):
    example(page, "Straight, with ranges")
    page.locator("#control-1").press("ArrowRight")
    page.wait_for_timeout(600)
    scene, address = page.evaluate("explorer.scenes.track"), page.url
    assert "#track=" in address
    for other in opened(browser[0], address):
        assert other.evaluate("explorer.scenes.track") == scene
    # What is no scene is not taken.
    for other in opened(browser[0], browser[1] + "#track=eyJwYXRoIjoiPGI-In0"):
        assert status(other) == "observable"


@pytest.mark.parametrize("name", ["track", "dipole", "radars"])
def test_copied_files_run(page, tmp_path, name):
    tab(page, name)
    said = status(page)
    (tmp_path / "scene.py").write_text(code(page, "python"))
    (tmp_path / "scene.toml").write_text(code(page, "toml"))
    run = {"cwd": tmp_path, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "scene.py"], **run, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.lower().startswith(said)
    done = subprocess.run(
        [sys.executable, "-m", "gramian", "analyze", "scene.toml"], **run, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert said in done.stdout.lower()


def test_dipole_equals_the_library(page):
    tab(page, "dipole")
    made = run_python(code(page, "python"))
    for known in (None, "its speed"):
        if known:
            page.select_option("#control-0", known)
            settle(page)
            made = run_python(code(page, "python"))
        answer = gm.analyze(made["problem"])
        assert status(page) == answer.status
        np.testing.assert_allclose(
            numbers(page, "explorer.answer.bound"), answer.crlb_std, rtol=1e-9
        )
        np.testing.assert_allclose(
            numbers(page, "explorer.answer.scale"), made["problem"].scale, rtol=1e-12
        )
    state = numbers(page, "explorer.answer.state")
    field = gm.dipole.measure(state[:3], state[3:6], state[6:], made["times"])
    np.testing.assert_allclose(
        numbers(page, "explorer.answer.field"), np.ravel(field), rtol=1e-9, atol=1e-20
    )
    assert "mirror image gives the same field" in page.inner_text("#facts")


def test_radars_equal_the_library(page):
    tab(page, "radars")
    for name in ("Across", "Along the baseline: unobservable"):
        example(page, name)
        made = run_python(code(page, "python"))
        args = made["positions"], made["sensors"], made["sigma"]
        answer = gm.analyze(gm.registration.problem(*args))
        assert status(page) == answer.status
        np.testing.assert_allclose(
            numbers(page, "explorer.answer.bound"), answer.crlb_std, rtol=1e-9
        )
        degrees = gm.registration.degree(*args)
        np.testing.assert_allclose(
            numbers(page, "explorer.answer.degrees"), degrees, rtol=1e-9, atol=1e-12
        )
    here = numbers(
        page,
        'explorer.ask("radars_map", [[0, 0, 60000, 0], [50, 0.002, 50, 0.002], [30000, 31000], [40000], [2000]])',
    )
    theirs = gm.registration.field(
        [[0, 0], [60e3, 0]], (50, 0.002), (30e3, 31e3, 40e3, 41e3), points=2
    )
    np.testing.assert_allclose(here.ravel(), theirs.values[0], rtol=1e-9)


CSV = "time,x,y,bearing_deg\n"


def table(times, place, bearings):
    """A file of bearings (rad) from places at times."""
    rows = zip(times.tolist(), place.tolist(), np.degrees(bearings).tolist(), strict=True)
    return CSV + "\n".join(f"{t},{x!r},{y!r},{b!r}" for t, (x, y), b in rows)


def turned(u, rng):
    """What no straight track explains: a turn in the middle; m, by the seconds."""
    late = np.maximum(u - u[-1] / 2, 0)
    return np.c_[6 * late, -9 * late], rng.normal(0, np.radians(0.5), len(u))


def outlying(u, rng):
    noise = rng.normal(0, np.radians(0.5), len(u))
    noise[[7, 31]] += np.radians([6, -8])
    return np.zeros((len(u), 2)), noise


def colored(u, rng):
    steps = rng.normal(0, np.radians(0.5), len(u) + 3)
    return np.zeros((len(u), 2)), 1.2 * np.convolve(steps, np.full(4, 0.5), "valid")


def turning_a_little(u, rng):
    late = np.maximum(u - u[-1] / 2, 0)
    return np.c_[2.5 * late, -3.75 * late], rng.normal(0, np.radians(0.4), len(u))


@pytest.mark.parametrize(
    ("made_so", "said"),
    [
        (turned, "would explain it"),
        (outlying, "without residuals 7 "),
        (turning_a_little, "shows in the residuals"),
        (colored, "neighbouring residuals are correlated"),
        ("stuck", "is stuck at one value from"),
    ],
)
def test_a_misfit_is_said_as_the_library_says_it(page, tmp_path, made_so, said):
    made = run_python(code(page, "python"))
    place = made["observer"].at(made["times"])[0]
    u = made["times"] - made["times"][0]
    x0, y0, vx, vy = made["state"].values()
    track = np.c_[x0 + vx * u, y0 + vy * u]
    rng = np.random.default_rng(5)
    if callable(made_so):
        way, noise = made_so(u, rng)
    else:
        way, noise = np.zeros((len(u), 2)), rng.normal(0, np.radians(0.5), len(u))
    bearings = np.arctan2(*(track + way - place).T) + noise
    if made_so == "stuck":
        bearings[40:52] = bearings[40]
    (tmp_path / "wrong.csv").write_text(table(made["times"], place, bearings))
    # A prior of the scene before is not one of the file.
    page.locator('[data-use="speed"]').check()
    page.set_input_files("#csv", tmp_path / "wrong.csv")
    settle(page)
    made = run_python(code(page, "python"))
    found = gm.tracks.estimate(made["scene"], [made["bearings"]])
    assert found.status == status(page) == "misfit"
    assert page.inner_text("#reason") == found.reason
    assert said in found.reason
    assert page.locator('[data-use="speed"]').is_disabled()


def test_measured_bearings(page, tmp_path):
    made = run_python(code(page, "python"))
    bearings = gm.tracks.simulate(made["scene"], made["state"], seed=3)
    place = made["observer"].at(made["times"])[0]
    file = tmp_path / "bearings.csv"
    file.write_text(table(made["times"], place, bearings))
    page.set_input_files("#csv", file)
    settle(page)
    made = run_python(code(page, "python"))
    found = gm.tracks.estimate(made["scene"], [made["bearings"]])
    np.testing.assert_allclose(
        numbers(page, "explorer.scenes.track.target"), found.state, rtol=1e-6
    )
    assert status(page) == found.status == "determined"
    assert page.inner_text("#reason") == found.reason
    times = made["times"]
    agree(page, found, float(times[-1] - times[0]))
    file.write_text(CSV + "0,0,0,10\n1,5,0,eleven\n2,9,0,12\n3,12,0,13\n")
    page.set_input_files("#csv", file)
    said = 'bearings.csv: bearing_deg, line 3 = "eleven": must be a number'
    page.wait_for_function(f"document.getElementById('reason').textContent === {json.dumps(said)}")


WRONG = {
    "track": [
        ("", "the file is empty"),
        ("# nothing\n\n", "the file is empty"),
        ("1,2,3,4\n2,3,4,5\n", "line 1 has numbers: the first line must name the columns"),
        ("time,x,y,depth\n0,0,0,1\n", "no column for bearing_deg among time, x, y, depth"),
        (CSV, "the file has 0 rows below its headings"),
        (CSV + "0,0,0,10\n1,1,1,nan\n2,2,2,12\n3,3,3,13\n", 'bearing_deg, line 3 = "nan"'),
        (CSV + "0,0,0,10\n1,1,1\n2,2,2,12\n3,3,3,13\n", 'bearing_deg, line 3 = ""'),
        (CSV + "0,0,0,10\n1,1,1,361\n2,2,2,12\n3,3,3,13\n", "must be between -360 and 360"),
        (CSV + "0,0,0,10\n2,1,1,11\n1,2,2,12\n3,3,3,13\n", "must be later than 2 s"),
        ("time,x,x_east,y,bearing\n0,0,0,0,1\n", "x and x_east may both be x"),
    ],
    "dipole": [
        ("", "the file is empty"),
        ("time,bx,by\n0,1,2\n", "no column for bz among time, bx, by"),
        ("time,bx,by,bz\n" + "0,0,0,0\n", "at least 6 are needed"),
        ("time,bx,by,bz\n" + "".join(f"{k},0,0,0\n" for k in range(9)), "field"),
        ("time,bx,by,bz\n0,1,2,3\n1,1,inf,3\n", 'by, line 3 = "inf": must be a number'),
    ],
    "radars": [
        ("", "the file is empty"),
        ("time,east\n0,1\n", "no column for y among time, east"),
        ("x,y\n0,1\n", "the file has 1 rows below its headings: at least 2"),
        ("x,y\n0,1\n1,two\n", 'y, line 3 = "two": must be a number'),
    ],
}


@pytest.mark.parametrize("name", WRONG)
def test_files_that_are_none_are_refused_in_words(page, tmp_path, name):
    tab(page, name)
    before = page.evaluate(f"JSON.stringify(explorer.scenes.{name})")
    for k, (text, said) in enumerate(WRONG[name]):
        file = tmp_path / f"wrong{k}.csv"
        file.write_text(text)
        page.set_input_files("#csv", file)
        page.wait_for_function(
            f"document.getElementById('reason').textContent.startsWith('{file.name}: ')"
        )
        assert said in page.inner_text("#reason")
        assert status(page) == "not read"
        assert page.evaluate(f"JSON.stringify(explorer.scenes.{name})") == before


def test_a_recorded_field(page, tmp_path):
    times = np.arange(0.0, 20.0, 0.5)
    truth = [-10.0, 6.0, 2.0], [1.0, -0.2, 0.05], [10.0, 20.0, 10.0]
    field = 1e9 * gm.dipole.simulate(*truth, times, 0.02e-9, seed=2) + [120.0, -40.0, 300.0]
    lines = [f"{t},{x!r},{y!r},{z!r}" for t, (x, y, z) in zip(times, field.tolist(), strict=True)]
    file = tmp_path / "field.csv"
    file.write_text("time,bx_nT,by_nT,bz_nT\n" + "\n".join(lines))
    tab(page, "dipole")
    page.evaluate("() => { explorer.scenes.dipole.noise = 0.02; }")
    page.set_input_files("#csv", file)
    page.wait_for_function("explorer.scenes.dipole.measured && explorer.calm")
    # The size of a pass is open: with the speed that the page's has, the library finds the same.
    made = run_python(code(page, "python"))
    found, ours = made["found"], numbers(page, "explorer.answer.state")
    theirs = np.concatenate([found.r0, found.v, found.m])
    # One record fits two passes, mirror images of each other.
    if ours[1] * theirs[1] < 0:
        theirs[:6] *= -1
    np.testing.assert_allclose(ours, theirs, rtol=1e-4)
    fit = numbers(page, "explorer.scenes.dipole.measured.fit")
    np.testing.assert_allclose(fit, [found.fit.chi2, found.fit.dof], rtol=1e-6)
    said = f"chi2 = {found.fit.chi2:.4g} for {found.fit.dof} degrees of freedom (p = "
    assert said in page.inner_text("#facts")
    assert status(page) == "unobservable"
    assert page.inner_text("#reason") == "rank 8 of 9: 1 combination is not determined"
    page.select_option("#control-0", "its speed")
    settle(page)
    assert status(page) == "observable"
    # What no pass explains is said first of what could be determined, and always.
    file.write_text(file.read_text() + "\n20.0,900,900,900")
    page.set_input_files("#csv", file)
    page.wait_for_function("document.getElementById('reason').textContent.includes(';')")
    assert status(page) == "unobservable"
    assert re.search("determined; chi2 = .*: the model does not fit$", page.inner_text("#reason"))
    page.select_option("#control-0", "its speed")
    settle(page)
    found = run_python(code(page, "python"))["found"]
    assert status(page) == found.status == "misfit"
    assert page.inner_text("#reason").split(" for ")[1] == found.reason.split(" for ")[1]


def test_a_track_between_two_radars(page, tmp_path):
    positions = np.array([[10e3, 20e3], [15e3, 26e3], [25e3, 30e3], [40e3, 31e3]])
    file = tmp_path / "track.csv"
    file.write_text(
        "t;east;north\n" + "\n".join(f"{k};{x};{y}" for k, (x, y) in enumerate(positions))
    )
    tab(page, "radars")
    page.set_input_files("#csv", file)
    page.wait_for_function("explorer.scenes.radars.track && explorer.calm")
    sensors, sigma = [[0, 0], [60e3, 0]], [50.0, np.radians(0.1)]
    degrees = gm.registration.degree(positions, sensors, sigma)
    np.testing.assert_allclose(numbers(page, "explorer.answer.degrees"), degrees, rtol=1e-9)
    made = run_python(code(page, "python"))
    np.testing.assert_array_equal(made["positions"], positions)


@pytest.mark.parametrize(
    ("ships", "said"), [("freighter", "observable"), ("tanker", "weak"), ("ferry", "unobservable")]
)
def test_the_demo_ships(page, ships, said):
    names = page.eval_on_selector_all("#control-0 option", "all => all.map((o) => o.value)")
    example(page, next(name for name in names if ships in name))
    made = run_python(code(page, "python"))
    assert status(page) == made["answer"].status == said
    # The recorded path has no handles until it is thinned.
    handles = "document.querySelectorAll('.handle').length"
    if "Waypoints to drag" in page.inner_text("#bar"):
        assert page.evaluate(handles) == 2
        page.click("text=Waypoints to drag")
        settle(page)
    assert page.evaluate(handles) > 4


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_telephone(browser, scheme):
    options = {"viewport": {"width": 390, "height": 844}, "color_scheme": scheme, "has_touch": True}
    for page in opened(*browser, **options):
        for name in ("track", "dipole", "radars"):
            tab(page, name)
            assert page.evaluate("document.documentElement.scrollWidth") == 390
            assert page.locator("#map").bounding_box()["width"] > 330
            assert (
                page.evaluate("getComputedStyle(document.body).backgroundColor")
                == {"light": "rgb(247, 248, 250)", "dark": "rgb(17, 22, 28)"}[scheme]
            )


def test_missing_target_is_said(tmp_path, monkeypatch, capsys):
    build = load_build()
    monkeypatch.setattr(build, "target_is_there", lambda: False)
    page = tmp_path / "explorer.html"
    assert build.main([str(page)]) == 3
    assert not page.exists()
    assert build.main([str(page), "--or-say-why"]) == 0
    for text in (page.read_text(), capsys.readouterr().err):
        assert "rustup target add wasm32-unknown-unknown" in text
