"""The code of docs/howto/sparse.md runs, and the command answers for a graph."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gramian.cli import app

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "sparse.md"


def test_the_code_of_the_page_runs(capsys):
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(block, names)
    said = capsys.readouterr().out
    assert "all height of the 3 blocks that nothing joins with the others (b0, b1, b2)" in said
    assert "translation along x of all 3 blocks" in said


def test_the_command_answers_for_a_graph(tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    text = re.search(r'"""(VERTEX.*?)"""', PAGE.read_text(), re.DOTALL)[1]
    path = tmp_path / "graph.g2o"
    path.write_text(text)
    result = CliRunner().invoke(app, ["analyze", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "UNOBSERVABLE: rank 6 of 9" in result.output
    assert "Bridges" in result.output
    assert "<img" in (tmp_path / "out" / "report.html").read_text()
