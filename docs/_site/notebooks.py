"""Notebooks of the tutorials, from the same text: tutorials/notebooks, which is not kept."""

import hashlib
from pathlib import Path

import jupytext

TUTORIALS = Path(__file__).parents[1] / "tutorials"


def notebook(page: Path):
    """Give the notebook of a page."""
    made = jupytext.read(page, fmt="md:myst")
    made.metadata.pop("jupytext", None)
    for number, cell in enumerate(made.cells):
        # The same in each build, and unique.
        cell["id"] = hashlib.sha256(f"{number}{cell.source}".encode()).hexdigest()[:8]
    return made


def write(app: object = None) -> None:
    """Write all of them."""
    out = TUTORIALS / "notebooks"
    out.mkdir(exist_ok=True)
    for page in sorted(TUTORIALS.glob("*.md")):
        (out / f"{page.stem}.ipynb").write_text(jupytext.writes(notebook(page), fmt="ipynb"))
