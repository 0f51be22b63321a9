"""A car that passes two magnetometers, as recorded."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

pytestmark = pytest.mark.recorded
EXAMPLE = Path(__file__).parents[2] / "examples" / "car_passes.py"


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(EXAMPLE))


@pytest.fixture
def passes(example, recorded):
    return list(example["passes"](recorded("car_magnetometer.csv")))


def test_one_dipole_explains_the_field_at_each_sensor_and_their_directions_agree(example, passes):
    assert len(passes) == 2
    for _, speed, times, field in passes:
        each = [example["alone"](times, field, s, speed) for s in (0, 1)]
        for found in each:
            assert found.explained >= 0.85
            assert 1.2 < found.closest.range < 2.0
            assert abs(found.direction[1]) > 0.9, "along the road, the sensors' y"
            assert found.speed == (pytest.approx(speed), 0.0)
            # One sensor cannot tell the mirror image.
            np.testing.assert_allclose(found.mirror.cost, found.cost, rtol=1e-6)
        assert example["angle"](*each) < 5
        first, second = (found.moment[0] for found in each)
        assert abs(first - second) < 0.15 * max(first, second)


def test_both_sensors_tell_the_speed_and_the_side(example, passes):
    for _, speed, times, field in passes:
        found = example["together"](times, field)
        assert found.speed[0] == pytest.approx(speed, rel=0.15)
        assert found.explained >= 0.85
        assert found.mirror is None or found.mirror.cost > 1.2 * found.cost
        assert found.direction[1] > 0.9, "from the first sensor to the second"


def test_the_time_between_the_sensors_agrees_with_the_dipoles_not_with_the_record(example, passes):
    """It needs no model of the car: the recorded speeds are in the ratio 1.6, the car's in 1.4."""
    means = []
    for _, _, times, field in passes:
        late = example["delays"](times, field, np.ones((2, 3), dtype=bool))
        speeds = [0.5 / value for value in late.values()]
        assert len(speeds) == 3
        assert max(speeds) < 1.08 * min(speeds)
        means.append(np.mean(speeds))
        for sources in (1, 3):
            found = example["together"](times, field, sources=sources)
            assert found.speed[0] == pytest.approx(means[-1], rel=0.06)
            wide = found.widened()
            low, high = wide.interval("speed").pieces[0]
            assert low < max(speeds)
            assert high > min(speeds)
            assert wide.status == found.status == "misfit"
            assert wide.reason == found.reason
        assert found.explained > 0.94
    assert 1.25 < means[1] / means[0] < 1.5


def test_a_fitted_correlation_does_not_pass_the_car_for_noise(passes, example):
    """Its residuals grow with the field: a speed that is wrong may not be called determined."""
    for _, _, times, field in passes:
        found = gm.dipole.localize(
            times, field, sensors=example["SENSORS"], background="fit", loss="huber",
            window="pass", missing="drop", correlation="fit",
        )  # fmt: skip
        assert found.status == "misfit"
        assert "the residuals grow with the field" in found.reason


def test_spikes_of_the_recorder_are_rejected(passes):
    _, speed, times, field = passes[0]
    assert abs(field).max() > 1e-3, "the record has spikes of 2 mT in a signal of 4 uT"
    kept = gm.dipole.localize(
        times, field[:, 0], {"speed": speed}, background="median", loss="huber"
    )
    assert kept.spikes > 0
    good = kept.weights[:, 0].min(axis=-1) > 0
    assert abs(field[good, 0] - kept.background).max() < 1e-5
    assert kept.closest.range == pytest.approx(1.5, abs=0.3)


def test_a_car_so_near_is_several_dipoles_and_no_quadrupole(passes):
    """The sensors are nearer than half its length, where the multipoles do not converge."""
    _, speed, times, field = passes[1]
    found = {}
    for sources in ("quadrupole", (1, "quadrupole", 2)):
        found[sources] = gm.dipole.localize(
            times, field[:, 0], {"speed": speed}, background="fit", loss="huber", window="pass",
            sources=sources,
        )  # fmt: skip
    several, one = found[1, "quadrupole", 2], found["quadrupole"]
    assert [about.sources for about, _ in several.candidates] == [2, 1, 1]
    assert [about.quadrupole for about, _ in several.candidates] == [False, True, False]
    assert one.quadrupole.any()
    assert 0.9 < one.explained < several.explained


def held_out(found, seconds):
    """Return the share of the field explained at each sensor, of samples left out of the fit.

    Blocks of so many seconds, one after the other, each left out at both sensors and told by the
    fit of the rest.
    """
    model, kept = found.model, found.model.weights > 0
    told = model.h(found.state).reshape(kept.shape)
    y, level = told + found.residuals, np.zeros((2, 3))
    constants = [name.startswith("background") for name in model.names]
    level[:] = found.state[constants].reshape(2, 3)
    block = np.floor((model.times - model.times[0]) / seconds)
    for one in np.unique(block):
        without = np.where((block == one)[:, None, None], 0.0, model.weights)
        rest = replace(model, weights=without)
        fit = rest.handle(y).minimize(found.state[None], ("squares", 0.0), 200)[0]
        told[block == one] = model.h(fit["x"]).reshape(kept.shape)[block == one]
    off, field = (np.where(kept, e, 0.0) ** 2 for e in (y - told, y - level))
    return 1 - off.sum(axis=(0, 2)) / field.sum(axis=(0, 2))


def test_four_dipoles_are_chosen_and_tell_what_the_fit_has_not_seen(example, passes):
    for (_, _, times, field), seconds in zip(passes, (0.11, 0.08), strict=True):
        found = example["together"](times, field, sources=(1, "quadrupole", 2, 3, 4))
        assert [about.sources for about, _ in found.candidates] == [4, 3, 2, 1, 1]
        # 0.6 m of the way.
        assert held_out(found, seconds).min() >= 0.95


def test_nothing_known_at_one_sensor_is_refused(passes):
    _, _, times, field = passes[1]
    with pytest.raises(gm.UnobservableError, match="speed"):
        gm.dipole.localize(times, field[:, 0], background="median", loss="huber", window="pass")


def test_the_example_runs(example, recorded, capsys):
    example["main"](recorded("car_magnetometer.csv"), most=2)
    text = capsys.readouterr().out
    assert text.count("sensor 1 alone") == 2
    assert text.count("misfit: neighbouring residuals are correlated") == 8
    assert text.count("by the time between the sensors") == 2
    assert "km/h" in text


def test_the_example_takes_broken_records_to_the_end(example, recorded, tmp_path, capsys):
    lines = recorded("car_magnetometer.csv").read_text().splitlines()
    broken = [lines[0]]
    for k, line in enumerate(lines[1:]):
        cells = line.split(",")
        if cells[0] == "car_20":
            # One channel is stuck, one is a copy of another, some numbers are lost.
            cells[3], cells[7] = "0.4", cells[6]
            cells[8] = "nan" if k % 50 == 0 else cells[8]
        else:
            # The second sensor is dead.
            cells[6:9] = ["0", "0", "0"]
        broken.append(",".join(cells))
    path = tmp_path / "broken.csv"
    path.write_text("\n".join(broken))
    example["main"](path, most=2)
    text = capsys.readouterr().out
    assert "1x is 4e-07 T throughout" in text
    assert "2y repeats 2x" in text
    assert "no answer" in text
    assert text.count("both sensors, the speed unknown") == 4
