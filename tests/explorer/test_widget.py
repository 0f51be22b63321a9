"""The explorer on a scene of one's own: as a widget, by the command, and what is refused."""

import json
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import gramian as gm
from explorer_page import settle
from gramian.cli import app
from gramian.explorer import Opened, opened, page
from gramian.models.tracks import Carrier, Motion, Scene, Sensor

TIMES = np.arange(0.0, 600.0, 20.0)
SHIP = Carrier([[0, 0], [1500, 0], [1500, 1500]], [0.0, 300.0, 600.0])
SCENE = Scene(Motion.constant_velocity(), [Sensor.bearing(SHIP, TIMES, sigma=0.005)])
STATE = {"x0": 3000.0, "y0": 4000.0, "vx": -4.0, "vy": 2.0}
PASS = {
    "model": "dipole",
    "pass": {"r0": [-10, 6, 2], "v": [1, 0, 0], "m": [10, 20, 10], "duration": 20, "step": 0.5, "sigma_nT": 1},
}  # fmt: skip
RADARS = {
    "model": "registration",
    "sensors": {
        "A": {"east": 0.0, "north": 0.0, "sigma_range": 50.0, "sigma_azimuth_deg": 0.1},
        "B": {"east": 60e3, "north": 0.0, "sigma_range": 30.0, "sigma_azimuth_deg": 0.2},
    },
    "tracks": {"t": {"start": [0.0, 2e4], "velocity": [500.0, 100.0], "duration": 60, "step": 1.0}},
}


# The front end of a notebook, in a few lines: a model with the traits of the widget, whose
# changes go to Python.
FRONT = """async ([esm, state]) => {
  const heard = {};
  window.model = {
    state, get: (name) => window.model.state[name], set: (name, value) => { window.model.state[name] = value; },
    save_changes: () => window.toPython(JSON.stringify(window.model.state.now)),
    on: (event, f) => { heard[event] = f; }, off: () => {},
    change: (name, value) => { window.model.state[name] = value; heard[`change:${name}`](); },
  };
  const url = URL.createObjectURL(new Blob([esm], { type: "text/javascript" }));
  const { default: widget } = await import(url);
  widget.render({ model: window.model, el: document.body });
}"""


@pytest.fixture
def shown(browser, tmp_path):
    """Return a function that shows a widget and gives the frame of its page."""
    pytest.importorskip("anywidget")
    started, _ = browser
    context = started.new_context(viewport={"width": 1200, "height": 1000})
    tab = context.new_page()
    said = []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    blank = tmp_path / "notebook.html"
    blank.write_text("<!doctype html><title>a notebook</title>")
    tab.goto(blank.as_uri())

    def show(widget):
        state = {key: widget.get_state()[key] for key in ("_page", "_height", "_opened", "now")}
        tab.expose_function("toPython", lambda text: widget.set_state({"now": json.loads(text)}))
        tab.evaluate(FRONT, [str(widget._esm), state])
        tab.wait_for_selector("iframe")
        frame = tab.frames[1]
        settle(frame)
        return tab, frame

    yield show
    context.close()
    assert said == []


def await_change(tab, widget, before):
    for _ in range(100):
        if widget.now and widget.now != before:
            return
        tab.wait_for_timeout(50)
    pytest.fail("the widget heard of no change")


def test_round_trip_of_a_scene_of_tracks(shown):
    widget = gm.explore(SCENE, STATE)
    with pytest.raises(gm.GramianError, match="has not been shown"):
        _ = widget.toml
    assert gm.explore(widget.scene).scene == widget.scene
    tab, frame = shown(widget)
    await_change(tab, widget, {})
    # What was given comes back as it was.
    ours, theirs = gm.analyze(gm.tracks.problem(SCENE, STATE)), gm.analyze(widget.problem)
    assert frame.inner_text("#status").lower() == theirs.status == ours.status == "observable"
    np.testing.assert_allclose(theirs.crlb_std, ours.crlb_std, rtol=1e-12)
    # The corner is dragged until the path is straight: changed there, changed here.
    before = widget.now
    frame.evaluate(
        "() => { explorer.scenes.track.path = [[0, 0], [750, 750], [1500, 1500]]; explorer.update(); }"
    )
    await_change(tab, widget, before)
    assert widget.now["status"] == gm.analyze(widget.problem).status == "unobservable"
    assert widget.scenario["carriers"][0]["path"] == [[0, 0], [750, 750], [1500, 1500]]
    assert gm.explore(widget.scenario).scene.scene["path"] == [[0, 0], [750, 750], [1500, 1500]]
    # By hand as well.
    before = widget.now
    box = frame.locator('[data-name="observer waypoint 2"]').bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 130, y, steps=4)
    tab.mouse.up()
    await_change(tab, widget, before)
    settle(frame)
    await_change(tab, widget, before)
    # Another scene, from Python.
    widget.show(PASS)
    tab.evaluate("(opened) => model.change('_opened', opened)", widget.get_state()["_opened"])
    frame.wait_for_function("explorer.tab === 'dipole' && explorer.calm")
    for _ in range(100):
        if widget.now["tab"] == "dipole":
            break
        tab.wait_for_timeout(50)
    answer = gm.analyze(
        gm.dipole.problem([-10, 6, 2], [1, 0, 0], [10, 20, 10], 0.5 * np.arange(41), 1e-9)
    )
    assert gm.analyze(widget.problem).null_combinations == answer.null_combinations


def test_the_three_tabs_open_on_scenes_of_ones_own(shown, tmp_path):
    widget = gm.explore(RADARS)
    tab, frame = shown(widget)
    await_change(tab, widget, {})
    sensors, sigma = [[0, 0], [60e3, 0]], [[50, np.radians(0.1)], [30, np.radians(0.2)]]
    track = np.array([0.0, 2e4]) + np.arange(61)[:, None] * [500.0, 100.0]
    theirs = gm.analyze(gm.registration.problem(track, sensors, sigma))
    np.testing.assert_allclose(gm.analyze(widget.problem).crlb_std, theirs.crlb_std, rtol=1e-9)
    bearings = gm.tracks.simulate(SCENE, STATE, seed=4)
    found = gm.tracks.estimate(SCENE, [bearings])
    for scene in (
        opened(found),
        opened(path=SHIP.at(TIMES)[0], times=TIMES, bearings=bearings, sigma=0.005),
    ):
        tab.evaluate(
            "(opened) => model.change('_opened', opened)",
            {"tab": scene.tab, "scene": scene.scene, "turn": 1},
        )
        frame.wait_for_function("explorer.tab === 'track' && explorer.calm")
        assert frame.inner_text("#status").lower() == found.status
        np.testing.assert_allclose(
            frame.evaluate("explorer.scenes.track.target"), found.state, rtol=1e-6
        )


def test_a_problem_knows_what_it_was_made_of():
    plain = opened(SCENE, STATE)
    problem = gm.tracks.problem(SCENE, STATE)
    assert opened(problem) == plain
    prior = opened(problem.prior({"vx": 2.0, "vy": 2.0})).scene
    assert prior["know"] == {"position": False, "speed": True}
    assert prior["prior"]["speed"] == 2.0
    for changed in (
        problem.fix("vx"),
        problem.keep_rows([0, 1, 2]),
        problem.with_scale([1, 1, 1, 1]),
    ):
        with pytest.raises(gm.InputError, match="does not say what it was made of"):
            opened(changed)
    assert gm.tracks.problem(SCENE, STATE) == problem


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "explore has no path, times, bearings, sigma"),
        ({"scene": 3}, "scene is int: must be a scenario"),
        ({"scene": SCENE}, "state is missing"),
        ({"scene": PASS, "state": STATE}, "state goes with a gm.tracks.Scene"),
        ({"scene": PASS, "sigma": 0.1}, "a scene and sigma"),
        ({"scene": {"model": "linear", "system": {"A": [[0.0]], "C": [[1.0]]}}}, 'does not show model = "linear"'),
        ({"path": [[0, 0]] * 4, "times": [0, 1, 1, 2], "bearings": [0.1] * 4, "sigma": 0.1}, r"times\[2\] = 1 s: must be later"),
        ({"path": [[0, 0]] * 4, "times": [0, 1, 2, 3], "bearings": [0.1] * 4, "sigma": 5.0}, "sigma = 5 rad: must be > 0"),
        ({"path": [[0, 0]] * 3, "times": [0, 1, 2, 3], "bearings": [0.1] * 4, "sigma": 0.1}, "the observer's place at each bearing"),
    ],
)  # fmt: skip
def test_what_is_no_scene_of_the_page_is_refused(given, said):
    with pytest.raises(gm.InputError, match=said):
        opened(**given)


def test_what_the_page_does_not_show_is_named():
    def scene(*sensors, motion=None):
        return Scene(motion or Motion.constant_velocity(), list(sensors))

    bearing = Sensor.bearing(SHIP, TIMES, sigma=0.005)
    other = Carrier([5.0, 5.0], name="coast")
    for given, said in (
        (scene(bearing, motion=Motion.constant_acceleration()), "a target with the states x0, y0, vx, vy, ax, ay"),
        (scene(bearing, Sensor.bearing(SHIP, TIMES, sigma=0.1)), "a second sensor of bearing"),
        (scene(bearing, Sensor.range(other, TIMES, sigma=9.0)), "range on another carrier"),
        (scene(Sensor.bearing(SHIP, TIMES, sigma=0.005, bias="compass")), "with a bias"),
        (scene(Sensor.cone_angle(SHIP, TIMES, sigma=0.005)), "a sensor of cone angle"),
        (scene(Sensor.bearing(SHIP, TIMES, sigma=np.linspace(1, 2, 30) * 1e-3)), "differ from sample"),
    ):  # fmt: skip
        state = dict.fromkeys(given.names, 1.0) | STATE
        with pytest.raises(gm.InputError, match="the explorer does not show") as caught:
            opened(given, state)
        assert said in str(caught.value)


def test_the_command_writes_the_page_with_the_scene(browser, tmp_path):
    file, out = tmp_path / "pass.toml", tmp_path / "page.html"
    file.write_text(
        'model = "dipole"\n[pass]\nr0 = [-10.0, 6.0, 2.0]\nv = [1.0, 0.0, 0.0]\n'
        "m = [10.0, 20.0, 10.0]\nduration = 20.0\nstep = 0.5\nsigma_nT = 3.0\n"
    )
    done = CliRunner().invoke(
        app, ["explore", str(file), "--out", str(out)], catch_exceptions=False
    )
    assert done.stdout == f"{out}\n"
    tab = browser[0].new_page()
    tab.goto(out.as_uri())
    settle(tab)
    assert tab.evaluate("explorer.tab") == "dipole"
    assert tab.evaluate("explorer.scenes.dipole.noise") == 3
    tab.close()


def test_a_scene_cannot_end_the_script_it_stands_in(browser):
    text = page(Opened("dipole", {"know": "</script><b>"}))
    assert "</script><b>" not in text


def test_without_anywidget_the_extra_is_named():
    text = (
        "import sys; sys.modules['anywidget'] = None; import gramian as gm\n"
        "scene = {'model': 'dipole', 'pass': {'r0': [-10, 6, 2], 'v': [1, 0, 0], 'm': [1, 2, 1],"
        " 'duration': 9, 'step': 0.5, 'sigma_nT': 1}}\n"
        "try: gm.explore(scene)\n"
        "except gm.GramianError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert "pip install 'gramian[notebook]'" in done.stdout
    assert "gramian explore FILE.toml" in done.stdout


def test_a_missing_page_is_said(monkeypatch, tmp_path):
    from gramian.explorer import _page

    monkeypatch.setattr(_page, "files", lambda _: tmp_path)
    with pytest.raises(gm.GramianError, match="make explorer"):
        page()
