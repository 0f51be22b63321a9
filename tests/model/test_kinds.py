"""Models of many fields, as people write them: their derivatives beside a complex step."""

import numpy as np
import pytest

import gramian as gm


def arm(x):
    """Tips of a planar arm of three joints and two unknown lengths."""
    tips = []
    for d in (0.0, 0.2, 0.5):
        one, two, three = x[0] + d, x[0] + x[1] + 3 * d, x[0] + x[1] + x[2] + 2 * d
        tips.append(x[3] * np.cos(one) + x[4] * np.cos(two) + 0.2 * np.cos(three))
        tips.append(x[3] * np.sin(one) + x[4] * np.sin(two) + 0.2 * np.sin(three))
    return np.array(tips)


def arm_on_a_turned_base(x):
    """The angle of the base beside that of the first joint: only their sum is seen."""
    first, second = x[0] + x[3] + np.array([0.0, 0.5, 1.0]), x[1]
    return np.concatenate([np.cos(first) + np.cos(first + second), np.sin(first + x[2])])


def rates(x):
    """Two rate constants over temperature: factors of 1e13 beside energies of 8e4."""
    inverse = 1 / (8.314 * np.array([350.0, 380.0, 420.0, 450.0]))
    return np.concatenate([np.log(x[0] * np.exp(-x[1] * inverse)), np.log(x[2]) - x[3] * inverse])


def enzyme(x):
    """Of the rate and the amount of the enzyme only the product is seen."""
    s = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
    return x[0] * s / (x[1] + s) * x[2]


def glass(x):
    """Refractive index over the wavelength."""
    square = np.linspace(0.4, 1.6, 9) ** 2
    return np.sqrt(1 + x[0] * square / (square - x[1]) + x[2] * square / (square - 100.0) + x[3])


def epidemic(x):
    infectious, susceptible, out = x[3], x[2] - x[3], []
    for day in range(120):
        new = x[0] * susceptible * infectious / x[2]
        susceptible, infectious = (
            susceptible - 0.5 * new,
            infectious + 0.5 * (new - x[1] * infectious),
        )
        if day % 10 == 9:
            out.append(infectious)
    return np.array(out)


def thermal(x):
    """Two rooms; of heat and capacities only ratios are seen."""
    one, two, out = x[0], x[1], []
    for step in range(60):
        flow = x[2] * (two - one)
        one, two = one + 100 * (flow + 280 - one) / x[4], two + 100 * (10 * x[3] - flow) / x[5]
        if step % 6 == 5:
            out.append(one)
    return np.array(out)


def orbit(x):
    """Ranges from a place in the plane y, z = 0: the roll about its axis is not seen."""
    at, speed, out = x[:3], x[3:], []
    for step in range(100):
        speed = speed - 10 * 3.986e14 * at / np.sum(at**2) ** 1.5
        at = at + 10 * speed
        if step % 10 == 9:
            out.append(np.sqrt(np.sum((at - np.array([6.378e6, 0.0, 0.0])) ** 2)))
    return np.array(out)


def mixed_units(x):
    return np.array([x[0] * 1e12 + x[2], x[1] * 1e-12 - x[2], x[0] * x[1], np.sin(x[2])])


def decays(x):
    t = np.linspace(0, 2000, 30)
    return x[0] * np.exp(-x[1] * t) + x[2] * np.exp(-x[3] * t)


def arrival_times(x):
    """Seconds, of metres."""
    beacons = np.array(
        [
            [2.66e7, 0, 0],
            [0, 2.66e7, 0],
            [0, 0, 2.66e7],
            [1.5e7, 1.5e7, 1.5e7],
            [-1.5e7, 1.5e7, 1.5e7],
        ]
    )
    return np.sqrt(((x[:3] - beacons) ** 2).sum(axis=1)) / 299792458.0 + x[3]


def barometer(x):
    """Four states of a pressure that shows two numbers only."""
    height = np.array([0.0, 100.0, 1000.0, 5000.0]) + x[3]
    return x[0] * (1 - 0.0065 * height / x[1]) ** 5.2559 * x[2]


def geodetic(x):
    """Degrees and metres."""
    lat, lon = x[0] * np.pi / 180, x[1] * np.pi / 180
    radius = 6378137 / np.sqrt(1 - 0.00669438 * np.sin(lat) ** 2)
    at = np.array(
        [
            (radius + x[2]) * np.cos(lat) * np.cos(lon),
            (radius + x[2]) * np.cos(lat) * np.sin(lon),
            (radius * (1 - 0.00669438) + x[2]) * np.sin(lat),
        ]
    )
    beacons = np.array(
        [
            [4.05e6, 5.7e5, 4.87e6],
            [4.06e6, 5.8e5, 4.871e6],
            [4.055e6, 5.9e5, 4.869e6],
            [4.04e6, 5.6e5, 4.88e6],
        ]
    )
    return np.sqrt(((at - beacons) ** 2).sum(axis=1))


def difference(x):
    """Two numbers of 1e5 of which only the difference is seen."""
    return np.array([x[1] - x[0], (x[1] - x[0]) ** 2])


#: The function, its state, the deviation of what it measures, its rank.
KINDS = [
    (arm, [0.3, -0.7, 1.1, 0.9, 0.6], 0.01, 5),
    (arm_on_a_turned_base, [0.3, -0.7, 1.1, 0.4], 0.01, 3),
    (rates, [1e13, 8.0e4, 2.0e13, 8.2e4], 1e-3, 4),
    (enzyme, [0.7, 0.2, 1.3], 1e-4, 2),
    (glass, [1.5, 0.01, 0.3, 1e-6], 1e-3, 4),
    (epidemic, [0.4, 0.1, 1e6, 10.0], 50.0, 4),
    (thermal, [293.0, 310.0, 0.5, 2.0, 1e4, 3e4], 0.05, 5),
    (orbit, [7e6, 1e5, 2e5, 10.0, 7500.0, 30.0], 10.0, 5),
    (mixed_units, [1e-12, 1e12, 1.0], 0.01, 3),
    (decays, [5.0, 1e-3, 20.0, 2e-3], 1e-3, 4),
    (arrival_times, [4.5e6, 4.2e5, 4.7e6, 1e-3], 1e-9, 4),
    (barometer, [101325.0, 288.15, 1.2, 1e3], 1.0, 2),
    (geodetic, [50.1234567, 8.1234567, 100.0], 1e-2, 3),
    (difference, [1e5, 1e5 + 1.0], 1e-3, 1),
]


@pytest.mark.parametrize(
    ("h", "x", "sigma", "rank"), KINDS, ids=lambda v: getattr(v, "__name__", "")
)
def test_a_model_of_another_field(h, x, sigma, rank):
    names = [f"x{i}" for i in range(len(x))]
    model = gm.from_function(h, x, sigma, names)
    exact = np.stack(
        [
            h(np.array(x) + 1j * 1e-30 * abs(x[i]) * np.eye(len(x))[i]).imag / (1e-30 * abs(x[i]))
            for i in range(len(x))
        ],
        axis=1,
    )
    answer, wanted = gm.analyze(model), gm.analyze(exact / sigma, names=names)
    assert answer.rank == wanted.rank == rank
    assert answer.status in {"observable" if rank == len(x) else "unobservable", "weak"}
    rounding = 1e-13 * np.abs(exact).max(axis=0)
    assert (np.abs(model.jacobian() - exact) <= 3 * model.accuracy.error + rounding).all()
    np.testing.assert_allclose(gm.crlb_std(model), gm.crlb_std(exact / sigma), rtol=1e-5)
    assert model.accuracy.evaluations <= 18 * len(x)
