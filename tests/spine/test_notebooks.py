"""The notebooks that the site makes of the tutorials run top to bottom."""

import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))


def test_there_is_one_for_each_tutorial():
    assert len(TUTORIALS) >= 7


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
@pytest.mark.filterwarnings("ignore")  # of the kernel's own sockets and paths
def test_it_runs(page, monkeypatch, tmp_path):
    pytest.importorskip("jupytext")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(str(DOCS))
    from _site.notebooks import notebook

    made = notebook(page)
    client = nbclient.NotebookClient(made, timeout=120, resources={"metadata": {"path": tmp_path}})
    client.execute()
    cells = [cell for cell in made.cells if cell.cell_type == "code"]
    assert len(cells) >= 1
    assert all(cell.execution_count for cell in cells)
    if "plot" in page.read_text():
        shown = [
            out for cell in cells for out in cell.outputs if "image/png" in out.get("data", {})
        ]
        assert shown, "no picture is shown"
    assert not any(out.output_type == "error" for cell in cells for out in cell.outputs)
    sys.modules.pop("_site.notebooks", None)
