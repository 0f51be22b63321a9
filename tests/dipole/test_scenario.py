"""Dipole scenarios, the command on them, the made example, and the paper's figures."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian.reproduce import dai_2020
from gramian.scenario import load

EXAMPLES = Path(__file__).parents[2] / "examples"
#: What examples/make_dipole_pass.py made the record of.
SPEED, RANGE, MOMENT = np.hypot(0.2, 7.0), 1.58, np.sqrt(60**2 + 25**2 + 70**2)


def write(tmp_path, text):
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    return path


def test_one_sensor_with_known_speed_and_a_prior_of_the_side():
    report = load(EXAMPLES / "dipole_one_sensor.toml").localize()
    found = report.data["localization"]
    assert report.headline == "LOCATED"
    assert found["closest"]["range"] == pytest.approx(RANGE, abs=0.05)
    assert found["moment"][0] == pytest.approx(MOMENT, rel=0.05)
    assert found["mirror"]["cost"] > found["cost"] + 10
    json.loads(report.to_json())
    for picture in report.pictures:
        picture.draw()


def test_two_sensors_find_the_speed():
    report = load(EXAMPLES / "dipole_two_sensors.toml").localize()
    found = report.data["localization"]
    value, std = found["speed"]
    assert abs(value - SPEED) < 4 * std
    assert value == pytest.approx(SPEED, rel=0.02)


def test_without_knowledge_the_refusal_is_a_report(tmp_path):
    text = (EXAMPLES / "dipole_one_sensor.toml").read_text()
    text = text.split("\n[known]")[0].replace(
        "dipole_pass.csv", str(EXAMPLES / "dipole_pass.csv").replace("\\", "/")
    )
    report = load(write(tmp_path, text)).localize()
    assert report.headline == "UNOBSERVABLE"
    assert "speed" in report.verdict
    assert load(write(tmp_path, text)).analyze().headline == "UNOBSERVABLE"


def test_analyze_an_assumed_pass_and_what_repairs_it(tmp_path):
    path = EXAMPLES / "dipole_table_1.toml"
    report = load(path).analyze()
    assert report.headline == "UNOBSERVABLE"
    known = write(tmp_path, path.read_text() + "\n[known]\nz = 5.0\nvz = 0.0\n")
    data = load(known).analyze().data["observability"]
    assert data["names"] == ["x0", "y0", "vx", "vy", "mx", "my", "mz"]
    bound = gm.crlb_std(
        gm.dipole.problem([-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-9).fix(
            "z0", "vz"
        )
    )
    np.testing.assert_allclose(data["crlb_std"], bound)
    speed = write(tmp_path, path.read_text() + "\n[known]\nspeed = 1.4142\n")
    assert load(speed).analyze().headline != "UNOBSERVABLE"


def test_simulate_reaches_the_bound(tmp_path):
    path = write(
        tmp_path,
        (EXAMPLES / "dipole_table_1.toml").read_text() + "\n[known]\nz = 5.0\nvz = 0.0\n",
    )
    report = load(path).simulate(200, 1)
    assert report.headline == "REACHES THE BOUND"
    assert len(report.pictures) == 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('unit = "uT"', 'unit = "V"'), "unit = 'V'"),
        (('unit = "uT"', 'unit = "T"'), "must be in tesla"),
        (("s1_x_uT", "s9_x_uT"), "has no column 's9_x_uT'"),
        (("speed = 7.003", "haste = 7.003"), "haste"),
        (("sigma = 3.0", "sigma = -3.0"), "must be > 0"),
        (('[["s1_x_uT"', '[["s2_x_uT", "s2_y_uT", "s2_z_uT"], ["s1_x_uT"'), "sensors has 1"),
    ],
)
def test_mistakes_are_named(tmp_path, change, message):
    text = (EXAMPLES / "dipole_one_sensor.toml").read_text()
    text = text.replace("dipole_pass.csv", str(EXAMPLES / "dipole_pass.csv").replace("\\", "/"))
    assert change[0] in text
    with pytest.raises(gm.ScenarioError, match=message):
        load(write(tmp_path, text.replace(*change))).localize()


def test_missing_cells_are_left_out_only_if_asked(tmp_path):
    lines = (EXAMPLES / "dipole_pass.csv").read_text().splitlines()
    cells = lines[300].split(",")
    lines[300] = ",".join([cells[0], "", *cells[2:]])
    (tmp_path / "holes.csv").write_text("\n".join(lines))
    text = (EXAMPLES / "dipole_one_sensor.toml").read_text().replace("dipole_pass.csv", "holes.csv")
    with pytest.raises(gm.ScenarioError, match=r"holes.csv:301: s1_x_uT = ''"):
        load(write(tmp_path, text)).localize()
    dropping = text.replace('unit = "uT"', 'unit = "uT"\nmissing = "drop"')
    found = load(write(tmp_path, dropping)).localize().data["localization"]
    assert found["dropped"] == 1


def test_a_record_is_described_by_more_than_a_dipole(tmp_path):
    t = np.arange(0.0, 20.0, 0.5)
    sensors = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]
    field = gm.dipole.simulate(
        [-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-11, seed=1, sensors=sensors
    )
    columns = [f"{axis}{s}" for s in (1, 2) for axis in "xyz"]
    table = np.c_[t, 1e9 * field.reshape(t.size, 6)]
    np.savetxt(
        tmp_path / "pass.csv", table, delimiter=",", header=",".join(["t", *columns]), comments=""
    )
    text = f"""
model = "dipole"
sensors = {sensors}
[record]
file = "pass.csv"
unit = "nT"
[record.columns]
time = "t"
field = [["x1", "y1", "z1"], ["x2", "y2", "z2"]]
[known]
z = 5.0
vz = 0.0
[fit]
background = "none"
loss = "gaussian"
window = {{ start = 0.0, end = 20.0 }}
sigma_nT = 0.01
sources = [1, 2]
motion = ["straight", "turning"]
attitude_deg = 0.5
scale = 0.01
correlation = 0.0
use = [true, true, true, true, false, true]
"""
    report = load(write(tmp_path, text)).localize()
    assert "one dipole explains" in report.verdict
    beside = report.tables[1]
    assert beside.title == "Beside the pass"
    assert [row[0] for row in beside.rows][-1] == "scale of sensor 2"
    with pytest.raises(gm.ScenarioError, match="motion"):
        load(write(tmp_path, text.replace('"turning"', '"spiral"'))).localize()
    with pytest.raises(gm.ScenarioError, match="attitude_deg"):
        load(write(tmp_path, text.replace("attitude_deg = 0.5", "attitude_deg = 0"))).localize()


def test_the_command_locates(tmp_path):
    done = subprocess.run(
        [
            *(sys.executable, "-m", "gramian", "localize"),
            *(EXAMPLES / "dipole_one_sensor.toml", "--out", tmp_path),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "LOCATED" in done.stdout
    assert (tmp_path / "report.html").exists()


def test_dai_2020():
    report = dai_2020.run(generations=30)
    data = report.data
    assert data["figure_2"]["relative_difference"] < 1e-14
    # Each published estimate is on the family of its printed u, within its rounding.
    for row in data["table_2"]:
        assert row["from_r"] == pytest.approx(row["printed"], rel=0.05)
        assert row["from_m"] == pytest.approx(row["printed"], rel=0.05)
    methods = {row["method"]: row for row in data["table_3"]}
    assert methods["published genetic algorithm"]["error"] == pytest.approx(0.04, abs=0.01)
    ours = methods["gramian, its own starts"]
    assert ours["error"] < 1e-8
    assert ours["cost"] < 1e-30
    for picture in report.pictures[:2]:
        picture.draw()


def test_sensors_of_the_total_field_from_a_file(tmp_path):
    path = EXAMPLES / "dipole_total_field.toml"
    report = load(path).analyze()
    assert "3 total-field sensors" in report.subtitle
    sensors, earth = [[0, 0, 0], [4, 0, 1], [0, 5, 2]], [2e-5, 1e-6, 4.5e-5]
    sigma = 1e-12 * np.array([[1.0], [1.0], [3.0]])
    times = np.arange(0.0, 20.1, 0.5)
    given = [-10, -9, 5], [1, 0.8, 0.1], [10, 20, -10], times, sigma
    bound = gm.crlb_std(gm.dipole.problem(*given, sensors=sensors, ambient=earth))
    np.testing.assert_allclose(report.data["observability"]["crlb_std"], bound, rtol=1e-9)
    report = load(path).simulate(200, 1)
    assert report.headline == "REACHES THE BOUND", report.verdict
    assert "sigma 0.001 to 0.003 nT" in report.subtitle
    told = write(tmp_path, path.read_text() + "\n[prior]\nvz = { mean = 0.1, sigma = 0.02 }\n")
    assert load(told).simulate(40, 1).headline == "AT THE BOUND"


def test_a_record_of_total_field_gradiometers_from_a_file(tmp_path):
    times = np.arange(0.0, 20.1, 0.25)
    sensors = [[0.0, 0.0, 0.0], [4.0, 0.0, 1.0], [0.0, 5.0, 2.0]]
    noise = np.array([[1e-12], [1e-12], [np.inf]])
    field = gm.dipole.simulate(
        [-10, -9, 5], [1, 0.8, 0.1], [10, 20, -10], times, noise, 1, sensors=sensors,
        ambient=[2e-5, 1e-6, 4.5e-5], baselines=[0.0, 0.0, 3.0],
    )  # fmt: skip
    field[:, 2] = 0.0
    table = np.column_stack([times, 1e9 * field])
    np.savetxt(tmp_path / "record.csv", table, delimiter=",", header="t,a,b,c", comments="")
    text = """
model = "dipole"
sensors = [[0.0, 0.0, 0.0], [4.0, 0.0, 1.0], [0.0, 5.0, 2.0]]
ambient_uT = [20.0, 1.0, 45.0]
baselines = [[0.0, 0.0, 3.0]]
record = { file = "record.csv", unit = "nT", columns = { time = "t", field = ["a", "b", "c"] } }
known = { vz = 0.1 }
fit = { background = "none", loss = "gaussian", window = "pass", sigma_nT = [0.001, 0.001, inf] }
"""
    scenario = load(write(tmp_path, text))
    report = scenario.localize()
    assert "3 total-field gradiometers" in report.subtitle
    assert "sigma 0.001 nT" in str(report.facts)
    found = report.data["localization"]
    np.testing.assert_allclose(found["r0"], [-10, -9, 5], atol=5 * max(found["pass_std"][:3]))
    assert found["status"] in ("determined", "ambiguous"), found["reason"]
    assert scenario.analyze().headline != "UNOBSERVABLE"
    for picture in report.pictures:
        picture.draw()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("ambient_uT = [20.0, 1.0, 45.0]", "ambient_uT = [0.0, 0.0, 0.0]"), "ambient_uT is 0"),
        (("sigma_nT = [0.001, 0.001, 0.003]", "sigma_nT = [0.001, 0.001]"), "3 of sensors, or 3"),
        (("sigma_nT = [0.001", "sigma_nT = [-0.001"), "must be > 0"),
        (("[pass]", "baselines = [[0, 0, 1], [0, 0, 1]]\n[pass]"), "baselines has 2 entries"),
        (("[pass]", "baselines = [[0, 0, 0]]\n[pass]"), "a baseline is 0"),
        (
            ("[pass]", 'record = { file = "a.csv", unit = "nT", columns = { time = "t", field = '
             '[["a", "b", "c"], ["a", "b", "c"], ["a", "b", "c"]] } }\n[ignored]'),
            "must name one column for each sensor",
        ),
    ],
)  # fmt: skip
def test_mistakes_of_sensors_are_named(tmp_path, change, message):
    text = (EXAMPLES / "dipole_total_field.toml").read_text()
    assert change[0] in text
    text = text.replace(*change).split("[ignored]")[0]
    with pytest.raises(gm.ScenarioError, match=message):
        load(write(tmp_path, text)).analyze()


BODY = (EXAMPLES / "dipole_body.toml").read_text()
TWO = "dipoles = [{ offset = [2.0, 1.0, 0.0], m = [-5.0, 3.0, 8.0] }]"
MORE = "acceleration = 0.01 "
FLAT = "quadrupole = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, -2.0]]"
#: Q m = 0.
CENTRED = "quadrupole = [[150.0, -30, -90], [-30, -36, 102], [-90, 102, -114]]"


@pytest.mark.parametrize(
    ("body", "names"),
    [
        (TWO, ["dx of dipole 2", "dy of dipole 2", "dz of dipole 2", "mx of dipole 2"]),
        ("acceleration = [0.01, 0.0, 0.02]", ["ax", "ay", "az"]),
        ("turn_rate_deg_s = 2.0", ["turn rate"]),
        (
            "turn_rate_deg_s = 2.0\ninduced_volume = 0.5\nearth_field_uT = [20.0, 0.0, 40.0]",
            ["turn rate", "induced volume"],
        ),
        ("attitude_deg = 1.0\nscale = 0.01", ["attitude x of sensor 1", "scale of sensor 4"]),
        (CENTRED, ["Qxx"]),
    ],
)
def test_what_passes_is_said_by_the_names_of_the_answer(tmp_path, body, names):
    text = BODY.replace(TWO, body).replace(MORE, "")
    if body == CENTRED:
        text = text.replace("z = 6.0\nvz = 0.0\n", "vx = 1.0\n")
    scene = load(write(tmp_path, text))
    found = scene.analyze().data["observability"]
    assert found["status"] == "observable"
    if body == CENTRED:
        assert sum(name.startswith("Q") for name in found["names"]) == 2
    else:
        assert set(names) <= set(found["names"])
    # The rows are the derivatives of what is simulated.
    experiment = scene.experiment().experiment
    passing = experiment._passing
    x, steps = passing.truth, np.array(found["crlb_std"])
    rows = passing.model.rows(x)
    for k in range(len(x)):
        there, back = x.copy(), x.copy()
        there[k] += steps[k]
        back[k] -= steps[k]
        change = (passing.read(there) - passing.read(back)).ravel() / (2 * steps[k])
        off = np.abs(change * passing.model.weights.ravel() - rows[:, k]).max()
        assert off < 1e-3 * np.abs(rows[:, k]).max(), passing.model.names[k]
    assert experiment.simulate(1, 0, 2).shape == (2, 40, 4, 3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (MORE, MORE + "\nturn_rate_deg_s = 2.0 ", "pass.acceleration: .* give one"),
        (MORE, "induced_volume = 0.1 ", "pass.earth_field_uT: .* give both"),
        (MORE, FLAT + " ", "pass.quadrupole: .* leave it or dipoles out"),
        (TWO, FLAT, r"pass.quadrupole: .* Q m = 0"),
        (TWO, FLAT.replace("-2.0", "-1.0"), "pass.quadrupole: .* must have a trace of 0"),
        (TWO, "attitude_deg = -1.0", "pass.attitude_deg = -1.0: must be > 0"),
        (", m = [-5.0, 3.0, 8.0] }", " }", r"pass.dipoles\[0\].m is missing"),
    ],
)
def test_what_is_wrong_with_a_body_names_the_key(tmp_path, old, new, message):
    assert old in BODY
    with pytest.raises(gm.InputError, match=message):
        load(write(tmp_path, BODY.replace(old, new))).analyze()


def test_trials_of_a_body_are_located_by_its_description():
    given = [-10, -10, 6], [1, 1, 0], [10, 20, 10], np.arange(0, 20, 0.5), 1e-11
    sensors = [[0.0, 0, 0], [0, 1.5, 0], [1.5, 0, 0.4], [-3, 2, 0]]
    more = {"sensors": sensors, "known": ["z0", "vz"], "acceleration": 0.01}
    scene = gm.monte_carlo.Dipole(*given, **more)
    assert scene.names[-1] == "acceleration along"
    found = gm.monte_carlo.run(scene, 12, seed=1)
    assert not found.failures
    # The root of the mean of 12 squares is within 0.2 of its own, three deviations of it.
    assert (abs(found.efficiency - 1) < 0.6).all()
    # A trial depends on its number alone.
    np.testing.assert_array_equal(scene.simulate(1, 5, 1)[0], scene.simulate(1, 0, 6)[5])
    # Errors of the sensors are drawn anew, and known to a deviation.
    tilted = gm.monte_carlo.Dipole(*given, sensors=sensors, known=["z0", "vz"], attitude=0.01)
    off = tilted.simulate(1, 0, 50) - gm.dipole.measure(*given[:4], sensors=sensors)
    assert off.std() > 3 * given[4]
    bound = gm.crlb_std(tilted.problem())
    assert (bound[[n.startswith("attitude") for n in tilted.names]] <= 0.01).all()


def test_a_body_with_a_prior_is_simulated(tmp_path):
    text = """
model = "dipole"
sensors = [[0.0, 0.0, 0.0], [0.0, 1.5, 0.0], [1.5, 0.0, 0.4], [-3.0, 2.0, 0.0]]
known = { vz = 0.0 }
prior = { z = { mean = 6.0, sigma = 0.002 } }
[pass]
r0 = [-10.0, -10.0, 6.0]
v = [1.0, 1.0, 0.0]
m = [10.0, 20.0, 10.0]
duration = 20.0
step = 1.0
sigma_nT = 0.01
acceleration = 0.01
"""
    scenario = load(write(tmp_path, text))
    report = scenario.simulate(20, 1)
    data = report.data
    # The root of the mean of 20 squares; the bound is that of the rows.
    rmse, least = np.array(data["rmse"]), np.array(data["bound"])
    assert (np.abs(rmse / np.where(least > 0, least, np.inf) - (least > 0)) < 0.7).all()
    given = [-10, -10, 6], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-11
    scene = gm.monte_carlo.Dipole(
        *given,
        sensors=[[0, 0, 0], [0, 1.5, 0], [1.5, 0, 0.4], [-3, 2, 0]],
        known=["vz"],
        prior={"z0": 0.002},
        acceleration=0.01,
    )
    bound = gm.crlb_std(scene.problem())
    np.testing.assert_allclose(least[:3], bound[:3], rtol=1e-6)
    assert least[2] < 0.002
