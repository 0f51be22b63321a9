"""Values with units and dates, wherever numbers are taken: converted, never stripped."""

import datetime as dt

import numpy as np
import pytest

import gramian as gm
from attack.baselines import CALLS, public
from gramian._units import WANTED

pint = pytest.importorskip("pint")
U = pint.UnitRegistry()

#: A unit that no argument of the package has.
WRONG = U.candela

T = np.arange(0.0, 200.0, 20.0)
PATH = np.stack([np.where(T < 100, 0.0, 4 * (T - 100)), 5 * np.minimum(T, 100.0)], axis=1)
STATE = np.array([2000.0, 6000.0, 3.0, -1.0])
SEEN = np.arctan2(*(STATE[:2] + T[:, None] * STATE[2:] - PATH).T)
R0, V, M = np.array([-10.0, -10.0, 5.0]), np.array([1.0, 1.0, 0.0]), np.array([10.0, 20.0, 10.0])
PASS_TIMES = np.linspace(0.0, 20.0, 41)


def numeric():
    """Every argument of every public function that is numbers alone."""
    for name, arguments in CALLS.items():
        if name == "linear.System":  # a record: read where it is used, as A and C are
            continue
        for key, value in arguments.items():
            if isinstance(value, (float, np.ndarray)) and not isinstance(value, bool):
                if isinstance(value, np.ndarray) and value.dtype.kind != "f":
                    continue
                yield pytest.param(name, key, id=f"{name}-{key}")


@pytest.mark.parametrize(("name", "key"), list(numeric()))
def test_a_unit_that_does_not_fit_is_refused(name, key):
    arguments = dict(CALLS[name])
    arguments[key] = arguments[key] * WRONG
    positional = arguments.pop("*", ())
    with pytest.raises(gm.InputError, match="candela"):
        public()[name](*positional, **arguments)


def same(found, wanted):
    """Whether two results have the same numbers, to rounding of the conversion."""
    if isinstance(wanted, np.ndarray):
        size = np.abs(wanted[np.isfinite(wanted)]).max(initial=0.0)
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * size)
        return
    names = ("crlb_std", "state", "r0", "v", "m", "statistic", "value", "path", "rows", "position")
    compared = [n for n in names if getattr(wanted, n, None) is not None]
    assert compared, wanted
    for name in compared:
        same(np.asarray(getattr(found, name)), np.asarray(getattr(wanted, name)))


KM, DEG, MIN, KN = 1000.0, np.pi / 180, 60.0, 1852 / 3600
G = gm

#: What is called: a function of converters to km, degrees, minutes, nT, knots.
CONVERTED = [
    ("bearings.rows", lambda km, deg, minute, nt, kn:
        G.bearings.rows(minute(T), km(PATH), STATE, deg(0.01))),
    ("bearings.problem", lambda km, deg, minute, nt, kn:
        G.analyze(G.bearings.problem(minute(T), km(PATH), STATE, sigma=deg(0.01)))),
    ("bearings.localize_many", lambda km, deg, minute, nt, kn:
        G.bearings.localize_many(minute(T), deg(SEEN), km(PATH), deg(0.01))),
    ("bearings.localize", lambda km, deg, minute, nt, kn:
        G.bearings.localize(minute(T), deg(SEEN), km(PATH), deg(0.01))),
    ("bearings.residuals", lambda km, deg, minute, nt, kn:
        G.bearings.residuals(minute(T), deg(SEEN + 0.01), km(PATH), STATE)),
    ("bearings.simulate", lambda km, deg, minute, nt, kn:
        G.bearings.simulate(minute(T), km(PATH), STATE, deg(0.01), seed=1)),
    ("bearings.gram", lambda km, deg, minute, nt, kn: G.bearings.gram(minute(T), deg(SEEN))),
    ("bearings.observability_test", lambda km, deg, minute, nt, kn:
        np.array(G.bearings.observability_test(minute(T), deg(SEEN), deg(0.01)).statistic)),
    ("dipole.field", lambda km, deg, minute, nt, kn: G.dipole.field(km([20.0, 0, 0]), M)),
    ("dipole.measure", lambda km, deg, minute, nt, kn:
        G.dipole.measure(km(R0), kn(V), M, minute(PASS_TIMES))),
    ("dipole.rows", lambda km, deg, minute, nt, kn:
        G.dipole.rows(km(R0), kn(V), M, minute(PASS_TIMES), nt(1e-9))),
    ("dipole.problem", lambda km, deg, minute, nt, kn:
        G.analyze(G.dipole.problem(km(R0), kn(V), M, minute(PASS_TIMES), nt(1e-9)))),
    ("dipole.localize", lambda km, deg, minute, nt, kn:
        G.dipole.localize(minute(PASS_TIMES), nt(FIELD), sigma=nt(1e-12), known={"z": 5.0, "vz": 0.0})),
    ("maneuver.fisher", lambda km, deg, minute, nt, kn:
        G.maneuver.fisher(km(PATH), km([2000.0, 6000.0]), sigma=deg(0.01))),
    ("maneuver.trajectory", lambda km, deg, minute, nt, kn:
        G.maneuver.trajectory(km([0.0, 1e4]), km([0.0, 0.0]), kn(5.0), minute(30.0), 20,
                              sigma=deg(0.01))),
    ("registration.eta", lambda km, deg, minute, nt, kn:
        G.registration.eta(km(PLACES), km(SENSORS), SIGMA2)),
    ("registration.rows", lambda km, deg, minute, nt, kn:
        G.registration.rows(km(PLACES), km(SENSORS), SIGMA2)),
    ("inertial.gravity", lambda km, deg, minute, nt, kn:
        np.array(G.inertial.gravity(deg(0.8), km(1000.0)))),
    ("tracks.Sensor", lambda km, deg, minute, nt, kn:
        G.tracks.rows(G.tracks.Scene(G.tracks.Motion.constant_velocity(), [
            G.tracks.Sensor.bearing(G.tracks.Carrier(km(PATH), minute(T)), minute(T),
                                    sigma=deg(0.01)),
            G.tracks.Sensor.range(G.tracks.Carrier(km([0.0, 0.0])), minute(T), sigma=km(10.0)),
        ]), STATE)),
]  # fmt: skip
FIELD = gm.dipole.measure(R0, V, M, PASS_TIMES)
PLACES, SENSORS, SIGMA2 = (CALLS["registration.eta"][k] for k in ("positions", "sensors", "sigma"))


def times_unit(unit, factor):
    return lambda value: np.asarray(value) / factor * unit


def plain(value):
    return np.asarray(value)


@pytest.mark.parametrize(("name", "call"), CONVERTED, ids=[c[0] for c in CONVERTED])
@pytest.mark.parametrize("library", ["pint", "astropy"])
def test_quantities_are_converted(name, call, library):
    if library == "pint":
        units = (U.km, U.deg, U.minute, U.nT, U.knot)
    else:
        units = pytest.importorskip("astropy.units")
        knot = units.def_unit("kn", 1852 / 3600 * units.m / units.s)
        units = (units.km, units.deg, units.minute, units.nT, knot)
    factors = (KM, DEG, MIN, 1e-9, KN)
    converters = [times_unit(u, f) for u, f in zip(units, factors, strict=True)]
    same(call(*converters), call(*[plain] * 5))


def test_what_has_a_unit_in_a_list_is_converted_too():
    target = [2 * U.km, 6 * U.km, 3 * U.m / U.s, -1 * U.m / U.s]
    same(gm.bearings.rows(T, PATH, target, 0.01), gm.bearings.rows(T, PATH, STATE, 0.01))
    path = [[x / 1000 * U.km, y * U.m] for x, y in PATH]
    same(gm.bearings.rows(T, path, STATE, 0.01), gm.bearings.rows(T, PATH, STATE, 0.01))
    with pytest.raises(gm.InputError, match=r"target\[0\] has the unit second"):
        gm.bearings.rows(T, PATH, [2 * U.s, 6, 3, -1], 0.01)
    with pytest.raises(gm.InputError, match="a state has several units"):
        gm.bearings.rows(T, PATH, STATE * U.m, 0.01)
    with pytest.raises(gm.InputError, match=r"^x has the unit meter, and no unit is known"):
        gm.from_function(lambda x: x, np.ones(2) * U.m, 1.0, ["a", "b"])


def test_frames_and_arrays_of_other_libraries():
    wanted = gm.bearings.rows(T, PATH, STATE, 0.01)
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    columns = {"t": T, "x": PATH[:, 0], "y": PATH[:, 1]}
    for frame in (pandas.DataFrame(columns), polars.DataFrame(columns)):
        found = gm.bearings.rows(frame["t"], frame[["x", "y"]], list(STATE), 0.01)
        np.testing.assert_array_equal(found, wanted)
    table = pytest.importorskip("pyarrow").table(columns)
    found = gm.bearings.rows(table["t"], table.select(["x", "y"]), STATE, 0.01)
    np.testing.assert_array_equal(found, wanted)
    xarray = pytest.importorskip("xarray")
    path = xarray.DataArray(PATH / 1000, dims=("time", "axis"), attrs={"units": "km"})
    same(gm.bearings.rows(T, path, STATE, 0.01), wanted)
    path.attrs["units"] = "furlong"
    with pytest.raises(gm.InputError, match="units = 'furlong', which is not known"):
        gm.bearings.rows(T, path, STATE, 0.01)
    path.attrs["units"] = "deg"
    with pytest.raises(gm.InputError, match="observer has the unit deg: must be convertible to m"):
        gm.bearings.rows(T, path, STATE, 0.01)
    short = pandas.DataFrame({"t": [0.0, 1.0, None, 3.0]}, dtype="Float64")
    with pytest.raises(gm.InputError, match="times"):
        gm.bearings.gram(short["t"], SEEN[:4])


@pytest.mark.parametrize("dated", [
    lambda t: np.datetime64("2026-05-01T12:00:00.25", "ns") + (t * 1e9).astype("timedelta64[ns]"),
    lambda t: [dt.datetime(2026, 5, 1, 12, 0, 0, 250000) + dt.timedelta(seconds=x) for x in t],
    lambda t: [dt.datetime(2026, 5, 1, 14, 0, 0, 250000, dt.timezone(dt.timedelta(hours=2)))
               + dt.timedelta(seconds=x) for x in t],
    lambda t: pytest.importorskip("pandas").to_datetime(1777636800.25 + t, unit="s", utc=True),
    lambda t: pytest.importorskip("pandas").Series(
        pytest.importorskip("pandas").to_datetime(1777636800.25 + t, unit="s", utc=True)),
    lambda t: pytest.importorskip("polars").Series(
        [dt.datetime(2026, 5, 1, 12, 0, 0, 250000) + dt.timedelta(seconds=x) for x in t]),
], ids=["datetime64", "datetime", "zones", "pandas index", "pandas", "polars"])  # fmt: skip
def test_dates_are_unix_seconds(dated):
    from gramian._arrays import finite

    np.testing.assert_array_equal(finite(dated(T), "times"), 1777636800.25 + T)
    found = gm.bearings.rows(dated(T), PATH, STATE, 0.01)
    np.testing.assert_allclose(found, gm.bearings.rows(T, PATH, STATE, 0.01), atol=1e-6)


def test_spans_are_seconds_and_dates_belong_in_times():
    spans = (T * 1e3).astype("timedelta64[ms]")
    np.testing.assert_array_equal(gm.bearings.gram(spans, SEEN), gm.bearings.gram(T, SEEN))
    days = np.array(["2026-05-01", "NaT"], dtype="datetime64[D]")
    with pytest.raises(gm.InputError, match=r"times\[1\] is no time"):
        gm.bearings.gram(days, SEEN[:2])
    with pytest.raises(gm.InputError, match="bearings holds dates: must be in rad"):
        gm.bearings.gram(T[:1], days[:1])


def of_known_unit():
    """Every argument of every public function whose name says its unit."""
    return [
        pytest.param(*case.values, id=case.id)
        for case in numeric()
        # A system of the caller's own has its own unit of time.
        if WANTED.get(case.values[1], "place") != "place"
        and not case.values[0].startswith(("linear.", "dynamics."))
        # A number there is the deviation of a bearing.
        and case.values != ("maneuver.scene", "sensors")
    ]


@pytest.mark.parametrize(("name", "key"), of_known_unit())
def test_the_unit_of_an_argument_is_taken(name, key):
    arguments = dict(CALLS[name])
    arguments[key] = (arguments[key] * U(WANTED[key])).to(OTHER[WANTED[key]])
    positional = arguments.pop("*", ())
    public()[name](*positional, **arguments)


OTHER = {
    "s": U.minute, "m": U.ft, "m/s": U.knot, "rad": U.deg, "rad/s": U.deg / U.s, "T": U.nT,
    "A*m**2": U.mA * U.m**2, "m/s**2": U.gravity, "m**3": U.liter,
}  # fmt: skip


def scene(times):
    carrier = gm.tracks.Carrier(PATH, times)
    sensor = gm.tracks.Sensor.bearing(carrier, times, sigma=1e-3)
    return gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])


#: Estimates with knowledge by name: of km and knots, as a unit of a library or as a factor.
KNOWING = [
    lambda km, kn: gm.bearings.localize_many(T, SEEN, PATH, 1e-3, {"x0": (2 * km, 0.5 * km)}).state,
    lambda km, kn: gm.bearings.localize(T, SEEN, PATH, 1e-3, {"vx": (6 * kn, 1 * kn)}).state,
    lambda km, kn: gm.estimate(
        gm.bearings.BearingsModel(T, PATH, np.array([1e-3])), SEEN, search=False,
        known={"x0": 2 * km}, prior={"vx": (6 * kn, 1 * kn)}, box={"y0": (1 * km, 9 * km)},
    ).state,
    lambda km, kn: gm.tracks.estimate(
        scene(T), [SEEN], known={"x0": 2 * km}, prior={"vx": (6 * kn, 1 * kn)}
    ).state,
    lambda km, kn: gm.tracks.rows(scene(T), {"x0": 2 * km, "y0": 6 * km, "vx": 6 * kn, "vy": -1.0}),
    lambda km, kn: gm.dipole.localize(
        PASS_TIMES, FIELD, {"vz": 0 * kn, "z": 0.005 * km}, prior={"x0": (-0.01 * km, 0.001 * km)},
        sigma=1e-12,
    ).state,
    lambda km, kn: gm.analyze(
        gm.bearings.problem(T, PATH, STATE, 1e-3), prior={"x0": 0.5 * km}
    ).crlb_std,
    lambda km, kn: gm.registration.estimate(
        gm.registration.simulate(PLACES, SENSORS, SIGMA2, seed=1), SENSORS, SIGMA2,
        prior={"A.range": 0.1 * km, "B.range": 0.1 * km},
    ).state,
]  # fmt: skip


@pytest.mark.parametrize("call", KNOWING)
@pytest.mark.parametrize("library", ["pint", "astropy"])
def test_what_is_known_by_name_may_have_units(call, library):
    if library == "pint":
        km, kn = U.km, U.knot
    else:
        units = pytest.importorskip("astropy.units")
        km, kn = units.km, KN * units.m / units.s
    np.testing.assert_allclose(call(km, kn), call(KM, KN), rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("call", KNOWING)
def test_what_is_known_by_name_in_another_unit_is_refused(call):
    with pytest.raises(gm.InputError, match="candela: must be convertible to m"):
        call(WRONG, WRONG)


def test_dates_are_times_of_tracks_and_passes():
    start = np.datetime64("2026-05-01T12:00:00")
    dates = start + (T * 1e3).astype("timedelta64[ms]")
    dated, plain_one = scene(dates), scene(T)
    assert dated.origin == gm.io.unix_seconds("2026-05-01T12:00:00")
    np.testing.assert_allclose(
        gm.tracks.rows(dated, STATE), gm.tracks.rows(plain_one, STATE), rtol=1e-6, atol=1e-6
    )
    found = gm.tracks.estimate(dated, [SEEN])
    np.testing.assert_allclose(found.track(dates[:2]), found.track(dated.origin + T[:2]))
    moments = start + (PASS_TIMES * 1e3).astype("timedelta64[ms]")
    known = {"vz": 0.0, "z": 5.0}
    by_date = gm.dipole.localize(moments, FIELD, known, sigma=1e-12)
    by_second = gm.dipole.localize(PASS_TIMES, FIELD, known, sigma=1e-12)
    assert by_date.closest.time - dated.origin == pytest.approx(by_second.closest.time, abs=1e-5)
    with pytest.raises(gm.InputError, match="holds dates"):
        scene(T).state({"x0": start, "y0": 6000.0, "vx": 3.0, "vy": -1.0})
