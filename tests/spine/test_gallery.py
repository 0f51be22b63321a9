"""Every script of the gallery runs, and has a picture to show."""

import runpy
from pathlib import Path

import pytest
from matplotlib.figure import Figure

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(
    path for header in EXAMPLES.glob("*/GALLERY_HEADER.rst") for path in header.parent.glob("*.py")
)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_runs_and_draws(script):
    made = runpy.run_path(str(script), run_name="__main__")
    pictures = [value for value in made.values() if isinstance(value, Figure)]
    assert pictures
    for picture in pictures:
        picture.canvas.draw()


def test_there_are_enough():
    assert len(SCRIPTS) >= 24
