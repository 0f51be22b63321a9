"""The benchmark suite's own parts: what it measures must be what it says."""

import json
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

import exact
import report
from harness import (
    OURS,
    Case,
    Contest,
    Contestant,
    Row,
    against,
    c_function,
    impossible,
    joined,
    markdown,
    pointer,
    run,
)
from limits import KINDS, READS, WRITES, Gauge, Limit, larger, measure, reading, writing

RATES = {"one": dict.fromkeys(KINDS, 1e9), "all": dict.fromkeys(KINDS, 2e9)}
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")


@needs_gcc
def test_every_limit_is_measured_however_short_the_time():
    rates = measure(seconds=0.0)
    for threads in ("one", "all"):
        assert set(rates[threads]) == set(KINDS)
        assert min(rates[threads].values()) > 1e7
    assert rates["one"]["fma"] > rates["one"]["divide"] > rates["one"]["sincos"] / 100


def test_the_slowest_group_of_operations_binds():
    rates = {"fma": 10.0, "sincos": 1.0, "divide": 2.0, "root": 1.0, "read 32 kB": 5.0,
             "read 32 MB": 1.0}  # fmt: skip
    limit = Limit({"fma": 20.0, "sincos": 1.0, "divide": 2.0, "root": 4.0, "read 32 MB": 4.5}, "")
    assert limit.best(rates) == (5.0, "divide + root")
    both = {**rates, "write 8 MB": 1.0}
    assert Limit({"read 32 MB": 2.0, "write 8 MB": 3.0}, "").best(both) == (3.0, "write 8 MB")
    assert Limit({"fma": 20.0, "sincos": 1.0}, "").best(rates) == (3.0, "fma + sincos")
    better = larger(RATES, {"one": dict.fromkeys(KINDS, 3e9), "all": dict.fromkeys(KINDS, 1e9)})
    assert (better["one"]["fma"], better["all"]["fma"]) == (3e9, 2e9)


@pytest.mark.parametrize("size", [0, 1, 2**15, 160e3, 2**21 - 1, 2**21, 3.2e6, 2**27, 1e12])
def test_what_is_read_is_bound_by_the_largest_array_that_is_no_larger(size):
    of = READS[reading(size)]
    larger_ones = [bytes_read for bytes_read in READS.values() if bytes_read > of]
    assert of <= max(size, 2**15)
    assert all(bytes_read > size for bytes_read in larger_ones)
    assert WRITES[writing(size)] == (2**23 if size >= 2**23 else 2**19)


def test_a_contest_lists_times_errors_and_what_failed():
    def fails(_):
        raise ImportError("no such peer | at all")

    contest = Contest(
        "sums",
        "number",
        1000.0,
        np.arange(1000.0),
        [
            Contestant(OURS, lambda data: data.sum),
            Contestant("slow", lambda data: lambda: sum(float(x) for x in data)),
            Contestant("wrong", lambda data: lambda: data[0] * np.nan),
            Contestant("missing", fails),
        ],
        limit=Limit({"read 32 kB": 8.0}, "8 bytes each"),
        cases={"well": Case(np.arange(11.0), lambda found: exact.relative(found, 55))},
        size=1000.0,
        series="sums against size",
    )
    rows = {row.contestant: row for row in run(contest, rounds=3, limits=RATES, seconds=1e-3)}
    assert rows[OURS].ratio == 1
    assert rows["slow"].ratio > 3
    assert rows[OURS].fraction == pytest.approx(8e-9 / rows[OURS].minimum)
    assert rows[OURS].errors == {"well": 0.0}
    assert rows[OURS].rates == {}
    assert rows["wrong"].errors == {"well": math.inf}
    assert rows["missing"].message == "ImportError: no such peer | at all"
    assert rows["missing"].minimum is None
    text = markdown(rows.values())
    lines = [line for line in text.splitlines() if line.startswith("|")]
    # A message must not break the table.
    assert {line.replace("\\|", "").count("|") for line in lines} == {7}
    assert "no digit" in text


def test_limits_take_their_turn_in_each_contest():
    class Slowing:
        """A machine that gets slower from round to round, and was ten times as fast before."""

        def __init__(self):
            self.asked = []

        def once(self, rates, wanted):
            self.asked.append(list(wanted))
            for threads, kind in wanted:
                of = rates.setdefault(threads, {})
                of[kind] = max(of.get(kind, 0.0), 1e8 / len(self.asked))

    gauge = Slowing()
    contest = Contest(
        "sums", "number", 1000.0, np.arange(1000.0),
        [
            Contestant(OURS, lambda data: data.sum),
            Contestant("two threads", lambda data: data.sum, threads=2, limit=Limit({"fma": 1.0}, "")),
        ],
        limit=Limit({"read 32 kB": 8.0}, "8 bytes each"),
    )  # fmt: skip
    ours, two = run(contest, rounds=3, limits=RATES, gauge=gauge, seconds=1e-3)
    assert gauge.asked == [[("all", "fma"), ("one", "read 32 kB")]] * 3
    assert (ours.rates, two.rates) == ({"read 32 kB": 1e8}, {"fma": 1e8})
    assert ours.fraction == pytest.approx(8e-8 / ours.minimum)


@needs_gcc
def test_the_gauge_keeps_the_best_rate():
    rates = {"one": {"fma": 1.0, "divide": 1e30}}
    Gauge().once(rates, [("one", "fma"), ("one", "divide"), ("all", "root")])
    assert rates["one"]["fma"] > 1e7
    assert rates["one"]["divide"] == 1e30
    assert rates["all"]["root"] > 1e7


def test_what_is_faster_than_its_limit_is_an_error_of_the_suite():
    fast, slow = (
        Row("c", name, "trial", 1, minimum=time, operations={"fma": 1.0}, rates={"fma": 1e9})
        for name, time in (("fast", 0.5e-9), ("slow", 2e-9))
    )
    against([fast, slow], RATES)
    assert impossible([fast, slow]) == [fast]
    text = report.worst([fast, slow])
    assert "## Errors of the suite" in text
    assert "| c | fast | 200% |" in text
    assert "slow" not in text


def test_slopes_are_those_of_whole_calls():
    rows = [
        Row("c", name, "trial", 1, work=size, minimum=each * size**power, size=size, series="s")
        for size in (10.0, 100.0, 1000.0)
        for name, each, power in ((OURS, 1e-9, 0.0), ("peer", 1e-8, 1.0))
    ]
    slopes = report.growth(rows)["s"]
    assert slopes[OURS] == pytest.approx(1.0)
    assert slopes["peer"] == pytest.approx(2.0)


def test_a_short_trial_is_taken_apart_into_call_trial_sample_and_memory():
    call, trial, sample, memory = 5e-6, 30e-9, 1e-9, 20e-9

    def row(kind, trials, samples):
        far = memory if trials >= 10_000 else 0.0
        each = call / trials + trial + samples * sample + far
        size = trials if kind == "trials" else samples
        return Row(
            "c", OURS, "trial", 1, minimum=each, size=size, series=f"sums against {kind}",
            fraction=0.5 * samples * sample / each,
        )  # fmt: skip

    rows = [row("trials", trials, 50) for trials in (10, 100, 1000, 10_000)]
    rows += [row("samples", 100, samples) for samples in (10, 100, 1000)]
    (found,) = report.shares(rows)
    assert found["kernel"] == "sums"
    assert found["call"] == pytest.approx(call)
    assert found["trial"] == pytest.approx(trial)
    assert found["sample"] == pytest.approx(sample)
    assert found["of the limit"] == pytest.approx(0.5)
    assert found["beyond the caches"] == pytest.approx(memory)
    assert report.shares(rows[:3]) == []


def test_what_did_not_run_and_who_is_faster_are_named():
    rows = [
        Row("c", OURS, "trial", 1, minimum=1.0, median=1.0, ratio=1.0),
        Row("c", "C", "trial", 1, minimum=0.5, median=0.5, ratio=0.5, errors={"well": 1e-16}),
        Row("c", "JAX", "trial", 1, message="ImportError: none"),
    ]
    text = report.worst(rows)
    assert "| c | C | 0.50 | well 1e-16 |" in text
    assert "| ImportError: none | JAX | c |" in text


def test_why_others_are_faster_is_said_where_they_are():
    rows = [
        Row(c, name, "trial", 1, median=1.0, ratio=ratio, why=f"why {c}" if name == OURS else "")
        for c, ratio in (("behind", 0.5), ("ahead", 2.0))
        for name in (OURS, "C", "numpy")
    ]
    text = report.worst(rows)
    assert text.count("\nbehind: why behind\n") == 1
    assert "why ahead" not in text


def test_one_start_is_compared_with_one_start():
    contest = Contest(
        "sums", "number", 1.0, np.arange(20_000.0),
        [
            Contestant(OURS, lambda data: lambda: [data.sum() for _ in range(9)]),
            Contestant("gramian, once", lambda data: data.sum),
            Contestant("numpy", lambda data: data.sum, against="gramian, once"),
            Contestant("lost", lambda data: data.sum, against="gramian, twice"),
        ],
        why="nine times the work",
    )  # fmt: skip
    ours, once, numpy, lost = run(contest, rounds=3, limits={}, seconds=1e-3)
    assert once.ratio == pytest.approx(once.median / ours.median)
    assert numpy.ratio == pytest.approx(numpy.median / once.median)
    assert lost.ratio is None
    assert (ours.why, numpy.why) == ("nine times the work", "")
    assert f"| {numpy.ratio:.3g} (gramian, once) |" in markdown([ours, once, numpy, lost])


def test_pictures_are_drawn(tmp_path):
    rows = [
        Row(
            "c", name, "trial", 1, work=10.0, minimum=size * 1e-6, median=size * 1e-6, ratio=1.0,
            errors={"well": 1e-16, "ill": 1e-9}, fraction=0.5, limit="fma: two", size=size,
            series=series,
        )
        for size in (10.0, 100.0)
        for name in (OURS, "C", "numpy")
        for series in ("", "time against size")
    ]  # fmt: skip
    report.pictures(rows, tmp_path)
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "accuracy.png",
        "limit.png",
        "size.png",
    }


def test_exact_numbers():
    rows = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    assert float(exact.det(exact.gram(rows))) == 24.0
    np.testing.assert_allclose(
        exact.bounds(exact.gram(rows)), np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    )


@needs_gcc
def test_c_kernels_agree_with_numpy_and_refuse_strides():
    rows = np.random.default_rng(1).normal(size=(3, 7, 4))
    out = np.empty((3, 4, 4))
    c_function("linear.c", "gram4")(rows, 3, 7, out)
    np.testing.assert_allclose(out, rows.transpose(0, 2, 1) @ rows, atol=1e-12)
    with pytest.raises(ValueError, match="contiguous"):
        pointer(rows[:, ::2])


def test_a_contestant_in_a_file_of_its_own_takes_part():
    rows = np.random.default_rng(0).normal(size=(3, 5, 4))
    contest = Contest(
        "gram of rows, 3 x 5 x 4", "trial", 3.0, rows,
        [Contestant(OURS, lambda data: lambda: np.einsum("tki,tkj->tij", data, data))],
    )  # fmt: skip
    names = [one.name for one in joined(contest)]
    assert names == [OURS, "SciPy dsyrk in a loop"]
    ours, guest = (one.prepare(rows)() for one in joined(contest))
    np.testing.assert_allclose(guest, ours, rtol=1e-12)
    assert len(joined(Contest("other", "trial", 1.0, None, contest.contestants))) == 1


def test_results_are_as_the_schema_says(tmp_path, monkeypatch):
    jsonschema = pytest.importorskip("jsonschema")
    import run as suite

    monkeypatch.setattr(suite, "RESULTS", tmp_path)
    monkeypatch.setattr(suite, "measure", lambda: RATES)
    made = suite.Run([], quick=True, record=False)
    made.parts_about = {"spine": {"seconds": 1.5, "peak memory, MiB": 100}}
    made.rows = [
        Row("c", OURS, "trial", 1, minimum=1.0, median=1.0, ratio=1.0, errors={"ill": math.inf}),
        Row("c", "peer", "trial", 1, message="ImportError: none"),
    ]
    made._write()
    schema = json.loads((Path(suite.HERE) / "schema.json").read_text())
    found = json.loads((tmp_path / "latest.json").read_text())
    jsonschema.validate(found, schema)
    assert set(found["rows"][0]) == set(schema["$defs"]["row"]["properties"])
    assert found["peers"]["numpy"] == np.__version__
    del found["rows"][0]["unit"]
    with pytest.raises(jsonschema.ValidationError, match="'unit' is a required property"):
        jsonschema.validate(found, schema)


def test_every_part_has_contests():
    for path in Path(report.__file__).parent.glob("bench_*.py"):
        assert "\ndef contests(" in path.read_text(), path.name
