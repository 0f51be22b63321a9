"""The README's Python runs and prints what it says."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parent.parent / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.S)


@pytest.mark.parametrize("block", BLOCKS)
def test_block_runs_and_prints_what_it_says(block, capsys):
    exec(compile(block, str(README), "exec"), {})
    printed = capsys.readouterr().out.split("\n")
    claimed = re.findall(r"print\(.*?\)\s*#\s*(.*)|\n# (.*)", block)
    claims = [a or b for a, b in claimed]
    assert claims, "the block claims nothing"
    for line, claim in zip(printed, claims, strict=False):
        said = claim.split(": on the line")[0]
        assert line.strip() == said.strip()
