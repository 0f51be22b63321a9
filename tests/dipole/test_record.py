"""What is wrong with a record is named before anything is fitted to it."""

import csv

import numpy as np
import pytest

import gramian as gm

T = np.arange(1200) * 0.01
# One behind the other: both see the same pass, half a second apart.
SENSORS = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])


def record(seed=1, sigma=1e-9):
    """A pass of two sensors in noise of `sigma`, (K, 2, 3)."""
    return gm.dipole.simulate(
        [-6, 1, 0.5], [1, 0, 0], [9, 5, 7], T, sigma, seed=seed, sensors=SENSORS
    )


def test_a_sound_record():
    found = gm.dipole.check_record(T, record())
    assert found.sound, found.summary()
    assert found.channels == ("1x", "1y", "1z", "2x", "2y", "2z")
    np.testing.assert_allclose(found.sigma, 1e-9, rtol=0.2)
    assert all(found.usable)


@pytest.mark.parametrize(
    ("change", "kind", "text"),
    [
        (lambda y: y[:, 1, 0].fill(2e-9), "constant", "2x is 2e-09 T throughout"),
        (lambda y: y[100:200, 0, 2].fill(3e-9), "stuck", "1z is stuck at 3e-09 T from 1 s to 1.99"),
        (lambda y: y[:, 1].__setitem__((slice(None), 1), 2 * y[:, 0, 0]), "copy", "2y repeats 1x times 2"),
        (lambda y: np.negative(y[:, 1, 2], out=y[:, 1, 2]), "axes", "2z follows 1z with the opposite"),
        (lambda y: y[:, 0, 0].__setitem__(50, 1e-6), "spikes", "1x has 1 spike, the first at 0.5 s"),
    ],
)  # fmt: skip
def test_faults_are_named(change, kind, text):
    y = record()
    change(y)
    found = gm.dipole.check_record(T, y)
    assert [f.kind for f in found.findings if f.text.startswith(text)] == [kind], found.summary()


def coarse(step=2e-7):
    """A record whose steps hide the noise: 2y keeps one value before the pass."""
    y = gm.dipole.simulate(
        [-6, 1, 0.5], [1, 0, 0], [300, 160, 230], T, 1e-8, seed=1, sensors=SENSORS
    )
    y += 1.3e-6
    return step * np.round(y / step)


def test_a_spike_elsewhere_does_not_make_a_coarse_channel_stuck():
    y = coarse()
    y[:300, 1, 1] = y[0, 1, 1]  # nothing passes yet: so would a sound channel read
    y[100, 0, 0] += 60e-6
    y[205, 0, 1] -= 60e-6
    kinds = {(f.kind, f.channel) for f in gm.dipole.check_record(T, y).findings}
    assert kinds == {("spikes", "1x"), ("spikes", "1y")}


def test_a_coarse_channel_is_stuck_while_others_see_a_pass():
    y = coarse()
    y[400:800, 1, 1] = 5 * 2e-7
    found = gm.dipole.check_record(T, y)
    assert [(f.kind, f.channel) for f in found.findings if f.kind == "stuck"] == [("stuck", "2y")]


def test_axes_that_are_swapped():
    y = record()
    y[:, 1] = y[:, 1][:, [1, 0, 2]]
    found = gm.dipole.check_record(T, y)
    assert [(f.kind, f.channel) for f in found.findings] == [("axes", "2x"), ("axes", "2y")]
    assert found.usable == (True, True, True, False, False, True)


def test_hum_in_all_channels_makes_none_a_copy():
    y = record()
    y += 2e-8 * np.sin(2 * np.pi * 16.7 * T)[:, None, None]
    found = gm.dipole.check_record(T, y)
    assert {f.kind for f in found.findings} == {"hum"}
    assert all(found.usable)


def test_copies_in_a_part_of_the_record_or_late():
    y = record()
    y[600:, 1, 1] = y[600:, 0, 0]
    found = gm.dipole.check_record(T, y)
    (copy,) = (f for f in found.findings if f.kind == "copy")
    assert copy.text == "2y repeats 1x, noise included, from 6 s to 11.99 s"
    assert found.usable == (True, True, True, True, False, True)
    y = record()
    y[2:, 1, 1] = y[:-2, 0, 0]
    (copy,) = (f for f in gm.dipole.check_record(T, y).findings if f.kind == "copy")
    assert copy.text == "2y repeats 1x 2 samples later, noise included"


def test_a_channel_without_samples_is_not_usable():
    y = record()
    y[:, 0, 2] = np.nan
    found = gm.dipole.check_record(T, y)
    assert [f.text for f in found.findings] == ["1z has no samples"]
    assert found.usable == (True, True, False, True, True, True)


def test_a_channel_unlike_the_others_and_a_level_that_steps():
    y, noise = record(), 1e-7 * np.random.default_rng(5).normal(size=T.size)
    y[:, 0, 2] += noise
    texts = [f.text for f in gm.dipole.check_record(T, y).findings]
    assert len(texts) == 1
    assert texts[0].startswith("1z has noise of ")
    y = record()
    y[:, 1, 0] = 3e-8 * np.round(y[:, 1, 0] / 3e-8)
    texts = [f.text for f in gm.dipole.check_record(T, y).findings]
    assert [t for t in texts if t.startswith("2x is rounded to 3e-08 T")], texts
    y = record()
    y[250:, 1, 0] += 1e-7
    texts = [f.text for f in gm.dipole.check_record(T, y).findings]
    assert [t for t in texts if t.startswith("2x steps by") and t.endswith("at 2.5 s and stays")]


def test_a_clock_that_jumps():
    t = T.copy()
    t[600:] += 0.5
    found = gm.dipole.check_record(t, record())
    assert str(found.findings[0]) == "the clock steps by 0.51 s to 6.5 s, usually by 0.01 s"
    t = T.copy()
    t[900:] = t[900] + 2 * (t[900:] - t[900])
    (found,) = gm.dipole.check_record(t, record()).findings
    assert str(found) == "the clock steps by 0.02 s to 9.02 s, usually by 0.01 s, 299 times"


def test_bad_input():
    with pytest.raises(gm.InputError, match=r"must be \(K,\) and \(K, 3\)"):
        gm.dipole.check_record(T, np.zeros((5, 3)))
    with pytest.raises(gm.InputError, match="channels"):
        gm.dipole.check_record(T, record(), channels=["x", "x"])
    with pytest.raises(gm.InputError, match=r"times\[3\]"):
        gm.dipole.check_record(np.where(np.arange(T.size) == 3, np.nan, T), record())


@pytest.mark.recorded
def test_recorded_car(recorded):
    """Two sound sensors with steps of 0.1 uT; one copied and one dead channel are named."""
    with recorded("car_magnetometer.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["pass"] == "car_20"]
    t = np.array([float(row["t_s"]) for row in rows])
    y = 1e-6 * np.array(
        [[[float(row[f"s{s}_{a}_uT"]) for a in "xyz"] for s in (1, 2)] for row in rows]
    )
    found = gm.dipole.check_record(t, y)
    assert all(found.usable), found.summary()
    # 2y reads 0.4 uT for 7 s before the car comes: steps of 0.2 uT, and spikes elsewhere.
    assert {f.kind for f in found.findings} == {"spikes"}, found.summary()
    np.testing.assert_allclose(found.step, 2e-7, rtol=0.01)
    broken = y.copy()
    broken[:, 0, 1] = 4e-6
    broken[:, 1, 2] = broken[:, 0, 2]
    named = {(f.kind, f.channel) for f in gm.dipole.check_record(t, broken).findings}
    assert {("constant", "1y"), ("copy", "2z")} <= named


def test_readings_of_the_total_field_have_no_axes_and_their_own_names():
    t = np.arange(400) * 0.01
    y = gm.dipole.simulate(
        [-2, 1, 0.5], [1, 0, 0], [9, 5, 7], t, 1e-9, seed=1,
        sensors=[[0, 0, 0], [0, 0.5, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 1], [0, 1, 1]],
        ambient=[2e-5, 0.0, 4e-5],
    )  # fmt: skip
    check = gm.dipole.check_record(t, y, components=1)
    assert check.channels == ("1F", "2F", "3F", "4F", "5F", "6F")
    assert check.sound, "sensors in a row see alike: no axes are swapped"
    y[:, 2] = y[5, 2]
    (finding,) = gm.dipole.check_record(t, y, components=1).findings
    assert (finding.kind, finding.channel) == ("constant", "3F")
    assert gm.dipole.check_record(t, y[:, 0], components=1).channels == ("F",)
    with pytest.raises(gm.InputError, match=r"field \(400, 6\): must be \(K,\) and \(K, 3\)"):
        gm.dipole.check_record(t, y)
    with pytest.raises(gm.InputError, match="components = 2: must be 3 or 1"):
        gm.dipole.check_record(t, y, components=2)
