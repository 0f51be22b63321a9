"""From files to an answer without a line of Python."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gramian as gm
from gramian.cli import app
from gramian.scenario import Choices, draft, load, schema

T = np.arange(0.0, 1200.0, 30.0)


def made(folder):
    """A ship that turns once, and its bearings of another that does not."""
    ship = np.stack([np.minimum(5 * T, 3000.0), np.maximum(0.0, 5 * T - 3000.0)], axis=1)
    other = np.array([3000.0, 6000.0]) + T[:, None] * [-2.0, 1.0]
    rng = np.random.default_rng(3)
    bearing = np.arctan2(*(other - ship).T) + rng.normal(0, np.radians(0.5), T.size)
    path, seen = folder / "own.csv", folder / "seen.csv"
    path.write_text(
        "when;x;y\n"
        + "".join(
            f"2026-05-01T12:{int(t // 60):02d}:{int(t % 60):02d}Z;{x:.1f};{y:.1f}\n".replace(
                ".", ","
            )
            for t, (x, y) in zip(T, ship, strict=True)
        )
    )
    seen.write_text(
        "when,bearing_deg\n"
        + "".join(
            f"{1777636800 + t:.0f},{np.degrees(b) % 360:.3f}\n"
            for t, b in zip(T, bearing, strict=True)
        )
    )
    return path, seen


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


def test_from_two_files_to_a_position(tmp_path):
    done = run("localize", *made(tmp_path), "--sigma-deg", 0.5, "--json")
    assert done.exit_code == 0
    answer = json.loads(done.stdout)
    assert answer["bearings"] == T.size
    state, std = np.array(answer["state"]), np.array(answer["std"])
    assert np.all(np.abs(state - [3000, 6000, -2, 1]) < 4 * std)


def test_import_writes_a_scenario_that_answers_the_same(tmp_path):
    files = made(tmp_path)
    toml = tmp_path / "mine.toml"
    done = run("import", *files, "--sigma-deg", 0.5, "--scenario", toml)
    assert "own" in done.stdout
    assert "2026-05-01T12:00:00Z" in done.stdout
    assert "mine.toml written" in " ".join(done.stdout.split())
    assert tomllib.loads(toml.read_text())["tracks"]["file"] == ["own.csv", "seen.csv"]
    again = json.loads(run("localize", toml, "--json").stdout)
    direct = json.loads(run("localize", *files, "--sigma-deg", 0.5, "--json").stdout)
    assert again["state"] == direct["state"]
    with pytest.raises(gm.StorageError, match="is there already"):
        run("import", *files, "--sigma-deg", 0.5, "--scenario", toml)


def test_a_start_may_be_a_date(tmp_path):
    files = made(tmp_path)
    toml = tmp_path / "mine.toml"
    run("import", *files, "--sigma-deg", 0.5, "--scenario", toml)
    text = toml.read_text().replace("start = 0.0", 'start = "2026-05-01T12:05:00Z"')
    toml.write_text(text.replace("duration = 1170.0", "duration = 600.0"))
    assert json.loads(run("localize", toml, "--json").stdout)["bearings"] == 21
    toml.write_text(toml.read_text().replace("T12:05", "T14:05"))
    with pytest.raises(gm.ScenarioError, match=r"\(2026-05-01T12:00:00Z\)"):
        run("localize", toml)
    toml.write_text(toml.read_text().replace("2026-05-01T14:05:00Z", "noon"))
    with pytest.raises(gm.ScenarioError, match=r"window\.start: 'noon'"):
        run("localize", toml)


def test_what_the_files_do_not_say_is_asked(tmp_path):
    own, seen = made(tmp_path)
    with pytest.raises(gm.InputError, match="--sigma-deg"):
        run("localize", own, seen)
    with pytest.raises(gm.InputError, match="is named 'radar'"):
        run("localize", own, seen, "--sensor", "radar", "--sigma-deg", 1)
    two = tmp_path / "two.csv"
    two.write_text("id,t,x,y\n" + "".join(f"{i},{t},{10 * t},{i}\n" for i in "abc" for t in (0, 60))
                   .replace(",a\n", ",1\n").replace(",b\n", ",2\n").replace(",c\n", ",3\n"))  # fmt: skip
    with pytest.raises(gm.InputError, match=r"which one is the observer\? \(--observer\)"):
        run("analyze", two)
    with pytest.raises(gm.InputError, match=r"which one is the target\? \(--target\)"):
        run("analyze", two, "--observer", "a")
    with pytest.raises(gm.InputError, match="--step is for other files"):
        run("analyze", tmp_path / "x.toml", "--step", 1)
    with pytest.raises(gm.InputError, match="stands alone"):
        run("analyze", tmp_path / "x.toml", own)


def test_schema_names_the_keys():
    assert "max_gap" in json.dumps(schema("bearings"))
    assert json.loads(run("schema", "bearings").stdout)["properties"]["noise"]
    with pytest.raises(gm.InputError, match="must be one of bearings"):
        schema("sonar")


def test_analyze_and_localize_speak_of_one_instant(tmp_path):
    own, seen = made(tmp_path)
    seen.write_text("".join(seen.read_text().splitlines(keepends=True)[:1] +
                            seen.read_text().splitlines(keepends=True)[5:]))  # fmt: skip
    toml = tmp_path / "mine.toml"
    run("import", own, seen, "--sigma-deg", 0.5, "--scenario", toml)
    found = json.loads(run("localize", toml, "--json").stdout)
    x0, y0, vx, vy = found["state"]
    at = f"\n[target]\nx0 = {x0}\ny0 = {y0}\nvx = {vx}\nvy = {vy}\n"
    toml.write_text(toml.read_text() + at)
    bound = json.loads(run("analyze", toml, "--json").stdout)
    assert bound["epoch"] == found["epoch"] == {"time": 120.0, "utc": "2026-05-01T12:02:00Z"}
    assert bound["bearings"] == found["bearings"] == T.size - 4
    # The bound is that of the same bearings: at the estimate it is the estimate's own.
    np.testing.assert_allclose(bound["observability"]["crlb_std"], found["std"], rtol=1e-6)


def test_the_start_of_the_window_in_its_three_forms(tmp_path):
    files = made(tmp_path)
    starts = ["300", "+300", "2026-05-01T12:05:00Z"]
    for start in starts:
        done = run(
            "localize", *files, "--sigma-deg", 0.5, "--start", start, "--duration", 600, "--json"
        )
        answer = json.loads(done.stdout)
        assert answer["epoch"] == {"time": 300.0, "utc": "2026-05-01T12:05:00Z"}
        assert answer["bearings"] == 21
    with pytest.raises(gm.InputError, match=r'start = \'noon\': must be seconds, a date .*"\+600"'):
        run("localize", *files, "--sigma-deg", 0.5, "--start", "noon")
    with pytest.raises(gm.InputError, match=r"starts at 9000 s \(2026-05-01T14:30:00Z\): what is"):
        run("localize", *files, "--sigma-deg", 0.5, "--start", "9000")
    toml = tmp_path / "mine.toml"
    run("import", *files, "--sigma-deg", 0.5, "--scenario", toml)
    for start in ('"+300"', '"2026-05-01T14:05:00+02:00"'):
        text = toml.read_text()
        line = next(line for line in text.splitlines() if line.startswith("start"))
        toml.write_text(text.replace(line, f"start = {start}"))
        assert json.loads(run("localize", toml, "--json").stdout)["epoch"]["time"] == 300


@pytest.mark.recorded
def test_recorded_maritime_files(recorded, tmp_path):
    files = [recorded("rep/sen_tracks.rep"), recorded("rep/sen_frig_sensor.dsf")]
    recording = gm.io.read(*files)
    assert {name: t.times.size for name, t in recording.tracks.items()} == {
        "Frigate": 164,
        "New_SSK": 164,
    }
    assert [d.times.size for d in recording.sensors.values()] == [47, 16, 16, 10, 6]
    # The bearings are cut to whole degrees, the ranges good to a part in 500.
    seen = recording.sensors["Frigate_Optic"]
    own = recording.track("Frigate").at(seen.times, 61)
    there = recording.track("New_SSK").at(seen.times, 61)
    off = np.degrees(np.angle(np.exp(1j * (np.arctan2(*(there - own).T) - seen.bearing))))
    assert np.abs(off).max() < 1.1
    first = np.hypot(*(there - own).T)[:10]
    np.testing.assert_allclose(seen.range[:10], first, rtol=5e-3)
    path = tmp_path / "rep.toml"
    path.write_text(draft(recording, Choices(sensor="Frigate_Optic", sigma_deg=0.5), tmp_path))
    assert load(path).localize().data["bearings"] == 47


@pytest.mark.recorded
def test_recorded_ships_and_aircraft(recorded):
    ships = gm.io.read(recorded("ais_solent.csv"))
    assert len(ships.tracks) == 11
    aircraft = gm.io.read(recorded("aircraft_uk.csv"))
    assert aircraft.track("A01").height is not None
    done = run(
        "analyze", recorded("ais_solent.csv"), "--observer", "observer_c", "--target", "ship_h",
        "--sigma-deg", 0.5, "--start", 1000, "--duration", 900, "--json",
    )  # fmt: skip
    assert json.loads(done.stdout)["observability"]["rank"] == 4


EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_table_of_a_magnetic_field_goes_to_an_answer(tmp_path):
    toml = tmp_path / "pass.toml"
    places = ["--sensor-at", "0,0,0", "--sensor-at", "0,0.5,0"]
    done = run("import", EXAMPLES / "dipole_pass.csv", *places, "--scenario", toml)
    assert "2 sensors in 1 pass" in done.stdout
    ours = json.loads(run("localize", toml, "--json").stdout)
    shipped = json.loads(run("localize", EXAMPLES / "dipole_two_sensors.toml", "--json").stdout)
    assert ours["localization"]["explained"] > 0.85
    assert ours["localization"] == shipped["localization"]


def test_a_pass_is_chosen_by_its_word(tmp_path):
    path = tmp_path / "two.csv"
    path.write_text(
        "run;time (s);Bx (nT);By (nT);Bz (nT)\n"
        + "".join(f"{name};{t};{t},5;1,0;2,0\n" for name in ("north", "south") for t in range(8))
    )
    answer = json.loads(run("import", path, "--json").stdout)
    assert answer["unit"] == "nT"
    assert answer["passes"] == {"north": 8, "south": 8}
    run("import", path, "--pass", "south", "--scenario", tmp_path / "south.toml")
    scenario = load(tmp_path / "south.toml")
    assert scenario.record.select.value == "south"
    assert scenario.sensors == [(0.0, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "2 sensors: give the place of each"),
        (["--sensor-at", "0,0"], "must be three numbers"),
        (["--sensor-at", "0,0,nan"], "must be three numbers"),
        (["--pass", "car_1"], "one pass and no name"),
    ],
)
def test_what_a_table_of_a_field_leaves_open_is_asked(options, message, tmp_path):
    toml = tmp_path / "pass.toml"
    with pytest.raises(gm.InputError, match=message):
        run("import", EXAMPLES / "dipole_pass.csv", *options, "--scenario", toml)
    assert not toml.exists()


@pytest.mark.recorded
@pytest.mark.parametrize(("one", "speed"), [("car_20", 20 / 3.6), ("car_32", 32 / 3.6)])
def test_the_recorded_car_goes_from_file_to_answer(one, speed, recorded, tmp_path):
    toml = tmp_path / "car.toml"
    places = ["--sensor-at", "0,0,0", "--sensor-at", "0,0.5,0"]
    path = recorded("car_magnetometer.csv")
    done = run("import", path, "--pass", one, *places, "--scenario", toml)
    assert "2 sensors in 2 passes" in done.stdout
    found = json.loads(run("localize", toml, "--json").stdout)["localization"]
    assert found["speed"][0] == pytest.approx(speed, rel=0.15)
    assert found["explained"] > 0.85
    # A car is more than one dipole, and what that leaves over is no noise.
    assert found["status"] == "misfit"
    assert "neighbouring residuals are correlated" in found["reason"]


def test_a_report_carries_the_digest_of_each_file(tmp_path):
    own, _ = made(tmp_path)
    other = tmp_path / "other.csv"
    other.write_text(own.read_text())
    toml = tmp_path / "two.toml"
    toml.write_text(
        'model = "bearings"\n[tracks]\nfile = "own.csv"\ntarget_file = "other.csv"\n'
        'observer = "own"\ntarget = "other"\n'
        "[window]\nduration = 600.0\nstep = 30.0\n[noise]\nbearing_deg = 0.5\n"
    )
    assert [path.name for path in load(toml).inputs] == ["two.toml", "own.csv", "other.csv"]


@pytest.mark.parametrize(
    ("option", "value"),
    [("sigma-deg", "nan"), ("sigma-deg", 0), ("sigma-deg", 90), ("step", "inf"), ("duration", -3)],
)
def test_a_number_that_no_file_holds_is_named_by_its_option(tmp_path, option, value):
    given = {"--sigma-deg": 0.5, f"--{option}": value}
    with pytest.raises(gm.InputError, match=f"^--{option} = {float(value)}: must be "):
        run("localize", *made(tmp_path), *(part for pair in given.items() for part in pair))
