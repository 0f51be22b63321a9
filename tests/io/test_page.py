"""The page on files has every format."""

from pathlib import Path

from gramian.io import FORMATS
from gramian.io._slips import CHECKS

PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "files.md").read_text(encoding="utf-8")


def test_the_table_of_formats_is_that_of_the_code():
    for name, cells in FORMATS.items():
        assert f"| `{name}` | {' | '.join(cells)} |" in PAGE


def test_every_check_is_named():
    assert all(f"`{name}`" in PAGE or f'"{name}"' in PAGE for name in CHECKS)
