"""Files that are endless, hostile or no text, given to every command that reads one."""

import os
import sys
from pathlib import Path

import pytest

import gramian as gm
from gramian import io
from gramian.cli import main

SHIP = "t,x,y\n0,0,0\n60,300,0\n"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    def command(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["gramian", *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        said = capsys.readouterr()
        return left.value.code or 0, said.out, said.err

    return command


def reading():
    for command in ("import", "analyze", "localize"):
        for name in ("a.csv", "a.gpx", "a.kml", "a.nmea", "a.rep", "a.parquet"):
            yield command, name
    for command in ("analyze", "localize", "plan", "simulate"):
        yield command, "a.toml"
    yield "analyze", "a.g2o"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX")
@pytest.mark.parametrize(("command", "name"), list(reading()))
def test_no_command_waits_for_a_pipe_or_reads_a_device(run, tmp_path, command, name):
    os.mkfifo(tmp_path / name)
    link = tmp_path / f"zero{Path(name).suffix}"
    link.symlink_to("/dev/zero")
    for file in (name, link.name):
        status, out, err = run(command, file)
        assert (status, out, err.count("\n")) == (1, "", 1), (file, err)


@pytest.mark.parametrize("name", ["a\0.csv", "a\0.gpx", "a\0.parquet", "."])
def test_what_no_file_can_be_called(name):
    with pytest.raises(gm.InputError, match="cannot be read"):
        io.read(name)


@pytest.mark.parametrize(("name", "text"), [
    ("deep.kml", "<kml>" + "<a>" * 50_000 + "</a>" * 50_000 + "</kml>"),
    ("bomb.kml", "<!DOCTYPE l [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><kml>&b;</kml>"),
    ("bomb.gpx", "<?xml version='1.0'?><!DOCTYPE l [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><gpx>&b;"),
    ("nul.csv", "t,x,y\n0,0,\0\n"),
    ("huge.csv", f"t,x,y\n0,{'9' * 5000},1\n"),
    ("quote.csv", 't,x,y\n0,"0,1\n'),
    ("long.csv", f"t,x,y\n{'a' * 200_000},0,1\n"),
    ("ais.nmea", "!AIVDM,9,9,9,A," + "w" * 500 + ",0*00\n"),
    ("a.rep", "99" * 5000 + "\n"),
    ("a.dsf", ';SENSOR:\t260501\t120000\t"A\n'),
    ("deep.toml", "model = 'bearings'\na = " + "[" * 900 + "]" * 900),
    ("dots.toml", "[" + ".".join("a" * 5000) + "]"),
    ("integer.toml", "model = 'bearings'\nn = " + "9" * 5000),
    ("key.toml", "model = 'bearings'\n" + "k" * 1_000_000 + " = 1"),
    ("value.toml", "model = 'bearings'\nnoise = '" + "v" * 1_000_000 + "'"),
    ("brackets.toml", "[" * 100_000),
    ("huge.g2o", f"VERTEX_SE2 0 {'9' * 5000} 0 0\n"),
])  # fmt: skip
def test_a_hostile_file_is_refused_in_a_short_line(run, tmp_path, name, text):
    (tmp_path / name).write_text(text)
    status, out, err = run("analyze" if name.endswith((".toml", ".g2o")) else "import", name)
    assert (status, out) == (1, "")
    assert "Traceback" not in err
    assert max(map(len, err.splitlines())) < 1000


def test_names_from_a_file_do_not_command_the_terminal(run, tmp_path):
    name = "\x1b]0;x\x07:ship:\x9b1m"
    rows = "".join(
        f"{name},{t},{5 * t},0\nother,{t},{900 - 5 * t},{2 * t}\n" for t in range(0, 600, 60)
    )
    (tmp_path / "a.csv").write_text("id,t,x,y\n" + rows)
    for arguments in (["import", "a.csv"], ["analyze", "a.csv", "--sigma-deg", "1"],
                      ["analyze", "a.csv", "--sigma-deg", "1", "--observer", "other"]):  # fmt: skip
        _, out, err = run(*arguments)
        assert not {"\x1b", "\x07", "\x9b"} & set(out + err)
        assert ":ship:" in out + err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux")
@pytest.mark.parametrize("arguments", [["import", "a.csv"], ["import", "a.csv", "--json"],
                                       ["schema", "bearings"], ["schema", "all", "--markdown"]])  # fmt: skip
def test_a_full_device_is_an_error(tmp_path, arguments):
    import subprocess

    (tmp_path / "a.csv").write_text(SHIP)
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gramian", *arguments], stdout=full, stderr=subprocess.PIPE,
            text=True, cwd=tmp_path, check=False, timeout=60,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "No space left" in done.stderr


def test_the_limit_of_size_can_be_raised(run, tmp_path):
    rows = "".join(f"{t},{5 * t},0\n" for t in range(120_000))
    (tmp_path / "a.csv").write_text("t,x,y\n" + rows)
    status, _, err = run("import", "a.csv", "--size-limit", "1")
    assert (status, "more than the limit of 1 MiB" in err, "--size-limit" in err) == (1, True, True)
    assert run("import", "a.csv", "--size-limit", "3")[0] == 0
    with pytest.raises(gm.InputError, match="size_limit"):
        io.read(tmp_path / "a.csv", size_limit=1000)
