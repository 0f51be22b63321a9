"""What holds for every command: exit status, --json, --strict, Ctrl-C, a plain install."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gramian.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"
DEMO = Path(__file__).parents[2] / "python" / "gramian" / "demo"
SHIP = "t_s,east_m,north_m\n" + "".join(f"{t},{5 * t},{t}\n" for t in range(0, 600, 30))
GRAPH = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 400
EDGE_SE2 1 2 1 0 0 100 0 0 100 0 400
"""

#: Command -> arguments of a question that is answered, of one answered no, of bad input,
#: of wrong usage; None where there is none.
COMMANDS = {
    "analyze": (
        ["analyze", DEMO / "1_easy.toml"],
        ["analyze", DEMO / "3_impossible.toml"],
        ["analyze", "missing.toml"],
        ["analyze"],
    ),
    "analyze a graph": (
        ["analyze", "graph.g2o"],
        ["analyze", "loose.g2o"],
        ["analyze", "missing.g2o"],
        ["analyze", "graph.g2o", "--unknown"],
    ),
    "localize": (
        ["localize", EXAMPLES / "localize" / "freighter.toml"],
        ["localize", "misfit.toml"],
        ["localize", "ship.csv"],
        ["localize", "ship.csv", "--duration", "long"],
    ),
    "plan": (
        ["plan", "plan.toml"],
        None,
        ["plan", DEMO / "1_easy.toml"],
        ["plan", "one.toml", "two.toml"],
    ),
    "simulate": (
        ["simulate", DEMO / "1_easy.toml", "--trials", "200"],
        ["simulate", DEMO / "3_impossible.toml", "--trials", "200"],
        ["simulate", "plan.toml"],
        ["simulate", DEMO / "1_easy.toml", "--trials", "many"],
    ),
    "reproduce": (
        ["reproduce", "dai-2020"],
        None,
        ["reproduce", "nobody-1999"],
        ["reproduce"],
    ),
    "demo": (["demo", "--out", "demo"], None, ["demo", "--out", "ship.csv"],
             ["demo", "here"]),
    "import": (["import", "ship.csv"], None, ["import", "misfit.toml"], ["import"]),
    "schema": (["schema", "bearings"], None, ["schema", "sonar"], ["schema"]),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that the table names."""
    place = tmp_path_factory.mktemp("commands")
    (place / "ship.csv").write_text(SHIP)
    (place / "graph.g2o").write_text("FIX 0\n" + GRAPH)
    (place / "loose.g2o").write_text(GRAPH)
    plan = (EXAMPLES / "plan_moving_target.toml").read_text()
    (place / "plan.toml").write_text(plan.replace("count = 60", "count = 12"))
    for name in ("launch.csv", "bearings.csv"):
        shutil.copyfile(EXAMPLES / "localize" / name, place / name)
    text = (EXAMPLES / "localize" / "freighter.toml").read_text()
    lines = (place / "bearings.csv").read_text().splitlines()
    noisy = np.random.default_rng(1).normal(0, 20, len(lines))
    body = [line.split(",") for line in lines[1:]]
    moved = [f"{a},{(float(b) + e) % 360:.3f}" for (a, b), e in zip(body, noisy, strict=False)]
    (place / "bearings.csv").write_text("\n".join([lines[0], *moved]) + "\n")
    (place / "misfit.toml").write_text(text)
    return place


@pytest.fixture
def run(folder, monkeypatch, capsys):
    """The command as it is entered, from its arguments to its exit status."""

    def command(arguments):
        monkeypatch.chdir(folder)
        monkeypatch.setenv("COLUMNS", "100")
        monkeypatch.setattr(sys, "argv", ["gramian", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main()
        said = capsys.readouterr()
        return left.value.code or 0, said.out, said.err

    return command


@pytest.mark.parametrize("name", COMMANDS)
def test_json_is_one_document_and_nothing_else(run, name):
    # The demo writes three pages, so it is run once, with --strict too.
    strict = ["--strict"] if name == "demo" else []
    status, out, err = run([*COMMANDS[name][0], "--json", *strict])
    assert (status, err) == (3 if strict else 0, "")
    assert isinstance(json.loads(out), dict)


@pytest.mark.parametrize("name", [n for n, c in COMMANDS.items() if c[1]])
def test_an_answer_that_is_no_is_an_answer(run, name):
    arguments = COMMANDS[name][1]
    status, shown, err = run(arguments)
    assert (status, err) == (0, "")
    assert run([*arguments, "--strict"]) == (3, shown, "")
    status, out, _ = run([*arguments, "--strict", "--json"])
    assert status == 3
    assert json.loads(out)


@pytest.mark.parametrize("name", COMMANDS)
def test_bad_input_is_named_in_a_line(run, name):
    status, out, err = run(COMMANDS[name][2])
    assert (status, out) == (1, "")
    assert err.startswith("error: ")
    assert "Traceback" not in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_wrong_usage_exits_with_2(run, name):
    status, out, err = run(COMMANDS[name][3])
    assert (status, out) == (2, "")
    assert "Usage" in err


#: Each command in one process without what the extras bring.
_PLAIN = """
import json, sys
from pathlib import Path
for name in ("matplotlib", "jinja2", "pyproj", "gpxpy", "pyais", "pyarrow", "pandas", "filelock"):
    sys.modules[name] = None
from gramian.cli import main
for name, arguments in json.loads(sys.argv[1]).items():
    sys.argv = ["gramian", *arguments]
    try:
        main()
    except SystemExit as left:
        sys.stderr.write(f"<{name}: {left.code or 0}>\\n")
"""


def test_a_plain_install_runs_every_command(folder, tmp_path):
    calls = {}
    for name, (arguments, *_) in COMMANDS.items():
        out = [] if name in ("schema", "demo") else ["--out", tmp_path / name]
        calls[name] = [str(a) for a in (*arguments, *out)]
    done = subprocess.run(
        [sys.executable, "-c", _PLAIN, json.dumps(calls)], cwd=folder, capture_output=True,
        text=True, timeout=120, check=True,
    )  # fmt: skip
    for name in COMMANDS:
        before, _, rest = done.stderr.partition(f"<{name}: ")
        assert rest.startswith("0>"), done.stderr
        # Said once, where a page was asked for.
        assert before.count("pip install 'gramian[report]'") == (name != "schema")
        done.stderr = rest
        if name not in ("schema", "demo"):
            assert [file.name for file in (tmp_path / name).iterdir()] == ["result.json"]


LONG = {
    "plan": ["plan", EXAMPLES / "plan_fixed_target.toml"],
    "simulate": ["simulate", EXAMPLES / "towed_array.toml", "--trials", "10000000"],
}


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("name", LONG)
def test_ctrl_c_stops_it_with_130(folder, name):
    process = subprocess.Popen(
        [sys.executable, "-m", "gramian", *map(str, LONG[name])], cwd=folder,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    time.sleep(2.5)
    assert process.poll() is None, process.communicate()
    # Python itself loses an interrupt that falls into a callback of an import.
    for _ in range(20):
        os.killpg(process.pid, signal.SIGINT)
        try:
            _, said = process.communicate(timeout=10)
            break
        except subprocess.TimeoutExpired:
            continue
    assert process.returncode == 130, said
    assert "Traceback" not in said


#: Ctrl-C a moment after the work began: all papers are done in two seconds.
_AT_WORK = """
import os, signal, sys, threading
import gramian.reproduce as papers
from gramian.cli import main
run = papers.reproduce
def started(name):
    papers.reproduce = run
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    return run(name)
papers.reproduce = started
sys.argv = ["gramian", "reproduce", "all"]
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_stops_reproduce_with_130(folder):
    done = subprocess.run(
        [sys.executable, "-c", _AT_WORK], cwd=folder, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert "stopped" in done.stderr
