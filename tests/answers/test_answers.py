"""What every answer can do, tested for every answer class there is."""

import copy
import importlib
import inspect
import json
import os
import pickle
import pkgutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian._answers import Answer
from gramian._values import Value

sys.path.insert(0, str(Path(__file__).parent))
import cases


@pytest.fixture(scope="module")
def values(tmp_path_factory):
    made = [value for make in cases.ALL for value in make()]
    return made + list(cases.files(tmp_path_factory.mktemp("files")))


def public_classes():
    """Every class that a public module of the package offers, but those of commands."""
    modules = [gm] + [
        importlib.import_module(found.name)
        for found in pkgutil.walk_packages(gm.__path__, "gramian.")
        if not any(part[0] == "_" for part in found.name.split("."))
        and found.name.rpartition(".")[2] not in {"plot", "scenario", "cli", "report"}
        and ".scenario." not in found.name
        and ".reproduce" not in found.name
    ]
    return {
        value
        for module in modules
        for value in (getattr(module, name) for name in getattr(module, "__all__", ()))
        if inspect.isclass(value) and value.__module__.startswith("gramian.")
    }


def answer_classes():
    return {c for c in public_classes() if issubclass(c, Value) and c not in {Answer, Value}}


def is_table(value):
    try:
        value.to_pandas()
    except gm.InputError:
        return False
    return True


def test_each_answer_class_has_a_case(values):
    made = {type(value) for value in values}
    assert answer_classes() - made == set()
    # And every public class is one, or is known not to be.
    others = {c.__name__ for c in public_classes() if not issubclass(c, (Value, Exception))}
    inputs = {"Experiment", "Bearings", "Dipole", "Linear", "Measurements", "Registration",
              "Tracks", "Estimates", "ProblemSource", "ABC"}  # fmt: skip
    tuples = {"Jacobian", "Pass"}
    rust = {"Monitor", "MonitorAnswer", "BearingMonitor"}
    inner = {name for name in others if name[0] == "_"}
    left = others - inputs - tuples - rust - inner
    assert left <= {
        "Chunk", "Statistics", "Task", "TrialTable", "Manifest", "Store", "Moments", "Tree",
        "Columns", "EstimationModel", "Entry", "Neighbours", "Opened",
    }, left  # fmt: skip


def test_everything_pickles_and_copies_equal(values):
    for value in values:
        for again in (pickle.loads(pickle.dumps(value)), copy.deepcopy(value)):
            assert type(again) is type(value)
            assert again == value, type(value)


def test_values_that_differ_are_not_equal(values):
    first = {}
    for value in values:
        if isinstance(value, Value):
            other = first.setdefault(type(value), value)
            assert value == other or value is not other
    rows = [[1.0, 0.0], [1.0, 1.0]]
    assert gm.analyze(rows) == gm.analyze(rows)
    assert gm.analyze(rows) != gm.analyze([[1.0, 0.0], [1.0, 1.0 + 1e-15]])
    assert gm.analyze(rows, names=["a", "b"]) != gm.analyze(rows)
    assert gm.Problem(rows, ["a", "b"]) != rows
    nan = gm.Problem(rows, ["a", "b"])
    assert np.isnan(nan.scale).all()
    assert nan == gm.Problem(rows, ["a", "b"])


def test_what_was_pickled_still_answers(values):
    for value in values:
        again = pickle.loads(pickle.dumps(value))
        if isinstance(value, gm.Observability):
            assert again.suggestions == value.suggestions
            assert again.std_of(value.names[0]) == value.std_of(value.names[0])
            np.testing.assert_array_equal(again.covariance(), value.covariance())
        if isinstance(value, gm.Estimate):
            assert again.summary() == value.summary()
        if isinstance(value, gm.linear.Levels):
            assert again.level_of({"x": 1.0}) == 0
        if isinstance(value, gm.bearings.Monitor):
            assert again.push(700.0, 0.3, 0.01) == value.push(700.0, 0.3, 0.01)


def test_every_answer_prints_in_a_line_and_as_html(values):
    for value in values:
        if not isinstance(value, Answer):
            continue
        for text in (str(value), repr(value)):
            assert text
            assert "\n" not in text
            assert len(text) < 240, text
        page = value._repr_html_()
        assert page.startswith("<div>")
        assert "background:#" in page
        assert json.loads(json.dumps(value.to_dict(), allow_nan=False)) == value.to_dict()


@pytest.mark.parametrize("end", ["json", "parquet"])
def test_every_answer_is_saved_and_loaded(values, end, tmp_path):
    if end == "parquet":
        pytest.importorskip("pyarrow")
    saved = 0
    for k, value in enumerate(values):
        if not isinstance(value, Answer):
            continue
        file = tmp_path / f"{k}.{end}"
        if end == "parquet" and not is_table(value):
            with pytest.raises(gm.InputError, match=r"table|levels|batch"):
                value.save(file)
            continue
        value.save(file)
        again = gm.load(file)
        assert type(again) is type(value)
        assert again == value, type(value)
        assert type(value).load(file) == value
        saved += 1
    assert saved > 25


def test_a_parquet_file_is_a_table_for_everybody(tmp_path):
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    problem = gm.Problem([[1.0, 0.0], [1.0, 1.0]], ["x", "v"], units=["m", "m/s"])
    gm.analyze(problem).save(tmp_path / "a.parquet")
    frame = pd.read_parquet(tmp_path / "a.parquet")
    assert frame["state"].tolist() == ["x", "v"]
    assert frame["unit"].tolist() == ["m", "m/s"]
    np.testing.assert_allclose(frame["crlb_std"], [1, 2**0.5])


def test_tables_have_names_and_units(values):
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    tables = 0
    for value in values:
        if not isinstance(value, Answer):
            continue
        if not is_table(value):
            continue
        frame = value.to_pandas()
        data = value.to_xarray()
        own = isinstance(value, (gm.registration.Field, gm.monte_carlo.MonteCarloResult))
        assert own or len(frame) == data.sizes[frame.index.name]
        tables += 1
    assert tables > 25
    path = next(v for v in values if isinstance(v, gm.maneuver.Trajectory))
    assert path.to_pandas().attrs["units"]["bearing"] == "rad"
    assert path.to_xarray()["east"].attrs["units"] == "m"
    found = next(v for v in values if isinstance(v, gm.bearings.Localizations))
    assert found.to_xarray()["covariance"].shape == (4, 4)
    assert found.to_xarray().unit.values.tolist() == ["m", "m", "m/s", "m/s"]


def test_a_model_of_the_users_own_is_saved_without_its_function(tmp_path):
    model = gm.from_function(cases.ranges, [30.0, 40.0], 1.0, ["east", "north"])
    found = gm.estimate(model, cases.ranges([31.0, 41.0]))
    found.save(tmp_path / "found.json")
    again = gm.load(tmp_path / "found.json")
    assert (again.status, again.reason) == (found.status, found.reason)
    np.testing.assert_array_equal(again.covariance, found.covariance)
    with pytest.raises(gm.InputError, match=r"ranges was not saved.*give the model again"):
        again.interval("east")


def test_files_that_are_no_answers_are_refused(tmp_path):
    file = tmp_path / "x.json"
    for text, what in [
        ("[1, 2]", "no answer"),
        ("{}", "no answer"),
        ('{"kind": "os.system", "fields": {}}', "there is no os.system"),
        ('{"kind": "cli.main", "fields": {}}', "there is no cli.main"),
        ('{"kind": "__main__.x", "fields": {}}', "there is no __main__"),
        ('{"kind": "Problem", "fields": {}}', "other fields"),
        ('{"kind": "Observability", "fields": {"status": "x"}}', "other fields"),
        ("\x00\x01", "no answer"),
    ]:
        file.write_text(text)
        with pytest.raises(gm.InputError, match=what):
            gm.load(file)
    with pytest.raises(gm.StorageError, match="cannot read"):
        gm.load(tmp_path / "none.json")
    answer = gm.analyze([[1.0]])
    with pytest.raises(gm.InputError, match=r"must end in \.json or \.parquet"):
        answer.save(tmp_path / "x.txt")
    answer.save(file)
    with pytest.raises(gm.InputError, match="holds a Observability: must be a Estimate"):
        gm.Estimate.load(file)


def test_no_pickle_is_involved(values, tmp_path):
    answer = next(v for v in values if isinstance(v, gm.Observability))
    answer.save(tmp_path / "a.json")
    code = (
        "import sys, pickle, gramian as gm\n"
        "def no(*a, **k): raise AssertionError('pickle')\n"
        "pickle.loads = pickle.load = no\n"
        f"print(gm.load({str(tmp_path / 'a.json')!r}))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == str(answer)


def test_a_problem_of_the_users_own_runs_in_other_processes():
    problem = gm.Problem([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], ["x", "v"]).prior({"v": 3.0})
    one = gm.monte_carlo.run(problem, 400, 1, "least_squares", workers=1, progress=False)
    two = gm.monte_carlo.run(problem, 400, 1, "least_squares", workers=2, progress=False)
    assert one == two
    assert os.cpu_count()
