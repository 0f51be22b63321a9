"""On a terminal every command that may take long says at once what it does."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "python" / "gramian" / "demo"
EXAMPLES = ROOT / "examples"

COMMANDS = {
    "working on 1_easy.toml": ["analyze", DEMO / "1_easy.toml"],
    "working on freighter.toml": ["localize", EXAMPLES / "localize" / "freighter.toml"],
    "reading": ["import", DEMO / "bay.csv"],
    "searching for a path": ["plan", "plan.toml"],
    "50 of 50": ["simulate", DEMO / "1_easy.toml", "--trials", "50"],
    "computing zhu-2013": ["reproduce", "zhu-2013"],
    "analysing 1_easy": ["demo", "--out", "demo"],
    "writing the report": ["analyze", DEMO / "1_easy.toml", "--out", "report"],
}
PLAN = """
model = "maneuver"
[target]
position = [0.0, 1000.0]
[observer]
start = [0.0, 0.0]
speed = 20.0
[bearings]
count = 8
step = 5.0
sigma_deg = 1.8
"""


@pytest.mark.parametrize("said", COMMANDS)
def test_a_terminal_shows_what_goes_on(tmp_path, said):
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "80"}
    words = [sys.executable, "-m", "gramian", *map(str, COMMANDS[said])]
    # Its answer goes into a pipe, and what it does to the terminal.
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=theirs, cwd=tmp_path, env=environment
    ) as run:
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 65536):
                shown += part
        except OSError:  # the end of a terminal
            pass
        answer = run.communicate()[0].decode()
    os.close(ours)
    assert run.returncode == 0, shown.decode()
    assert said in shown.decode()
    assert answer
    assert "\x1b" not in answer
