"""The README's Python, and that of the pages in docs, runs and prints what it says."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BLOCKS = re.compile(r"```python\n(.*?)```", flags=re.S)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES = [page for page in PAGES if BLOCKS.search(page.read_text())]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_blocks_run_and_print_what_they_say(page, capsys):
    names = {}
    for block in BLOCKS.findall(page.read_text()):
        exec(compile(block, str(page), "exec"), names)
        printed = capsys.readouterr().out.splitlines()
        claims = [a or b for a, b in re.findall(r"print\(.*?\)\s*# (.*)|\n# (.*)", block)]
        assert claims, f"a block claims nothing: {block}"
        assert printed == [claim.split(": on the line")[0] for claim in claims]
