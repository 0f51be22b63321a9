"""How the kernels' instruction counts went: a table for the docs, from the repository's history.

    python benches/history.py

One column for each release that has counts (`benches/instructions.json` at its tag), and for
the newest records. Between columns of other compilers a change may be the compiler's.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
RECORD = "benches/instructions.json"
PATH = "avx2"
NEWEST = 5  # records that are shown beside the releases


def git(*words: str) -> str:
    """Return what git prints; nothing where it fails."""
    done = subprocess.run(
        ["git", *words], capture_output=True, text=True, cwd=HERE.parent, check=False
    )
    return done.stdout


def recorded(commit: str) -> dict[str, Any] | None:
    """Return the record of a commit, if it has one of this vector path."""
    try:
        found: dict[str, Any] = json.loads(git("show", f"{commit}:{RECORD}"))[PATH]
    except (ValueError, KeyError):
        return None
    return found


def columns() -> list[tuple[str, dict[str, Any]]]:
    """Return the releases and the newest records with their counts, the oldest first."""
    lines = git("log", f"-{NEWEST}", "--format=%h %as", "--", RECORD).splitlines()
    newest = [(f"{line.split()[1]} ({line.split()[0]})", line.split()[0]) for line in lines]
    tags = git("tag", "--list", "v*", "--sort=creatordate").split()
    named = [(tag, tag) for tag in tags] + newest[::-1]
    found = [(name, recorded(commit)) for name, commit in named]
    return [(name, record) for name, record in found if record]


def main() -> None:
    """Write HISTORY.md."""
    shown = columns()
    if not shown:
        raise SystemExit("no record in the history: a clone with its history is needed")
    names = list(shown[-1][1]["instructions"])
    rows = []
    for name in names:
        counts = [record["instructions"].get(name) for _, record in shown]
        known = [count for count in counts if count]
        change = f"{known[-1] / known[0] - 1:+.0%}" if len(known) > 1 else ""
        rows.append([name, *(f"{c:,}".replace(",", " ") if c else "" for c in counts), change])
    compilers = ", ".join(dict.fromkeys(record["compiler"] for _, record in shown))
    text = f"""# Instruction counts over time

Written by `python benches/history.py` from the records that `python benches/check.py --record`
leaves in the repository: instructions of each kernel on fixed inputs, AVX2, by callgrind. The
last column is the change from the first count shown to the last. Compilers: {compilers}.

"""
    head = ["kernel", *(name for name, _ in shown), "change"]
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    (HERE / "HISTORY.md").write_text(text + table)
    print(f"HISTORY.md: {len(rows)} kernels, {len(shown)} records")


if __name__ == "__main__":
    main()
