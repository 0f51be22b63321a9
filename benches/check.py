"""Compare the kernels' instruction counts with the recorded ones.

    python benches/check.py [--record]

Counts are by callgrind on fixed inputs: the same on a busy machine and an idle
one. They are recorded by vector path: callgrind has no AVX-512, so on any x86-64
machine with AVX2 it is that path that is counted. A compiler of another version
counts differently: the one of the record is named. Exit status 1 when a kernel
moved by more than 3 %.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent
RECORD = HERE / "instructions.json"
TOLERANCE = 0.03


def build() -> Path:
    """Build the program that runs one kernel, and return its path."""
    command = ["cargo", "build", "--release", "-p", "gramian", "--example", "count_kernel"]
    command += ["--message-format=json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=HERE.parent, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    messages = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return Path(next(m["executable"] for m in messages if m.get("executable")))


def instructions(program: Path, name: str, repeats: int) -> int:
    """Count the instructions of a run."""
    with tempfile.NamedTemporaryFile() as out:
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out.name}"]
        command += [str(program), name, str(repeats)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    found = re.search(r"Collected\s*:\s*(\d+)", done.stderr)
    if done.returncode or not found:
        sys.exit(f"{' '.join(command)} failed:\n{done.stderr}")
    return int(found.group(1))


def compiler() -> str:
    """Return the version of rustc."""
    done = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True)
    return done.stdout.split(" (")[0].strip()


def main() -> None:
    if shutil.which("valgrind") is None:
        sys.exit(
            "valgrind, which counts the instructions, is not installed (apt install valgrind). "
            "Without it `cargo bench -p gramian --bench kernels` times the same kernels."
        )
    program = build()
    # As valgrind shows the processor, not as it is.
    told = subprocess.run(
        ["valgrind", "--tool=none", "--quiet", program], capture_output=True, text=True, check=True
    )
    path, *names = told.stdout.split()
    path = path.strip("()").lower()

    def count(name: str) -> int:
        # The difference leaves out what making the inputs takes.
        return instructions(program, name, 3) - instructions(program, name, 2)

    with ThreadPoolExecutor(2) as pool:
        counts = dict(zip(names, pool.map(count, names), strict=True))
    record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    known = record.get(path, {}).get("instructions", {})
    by = record.get(path, {}).get("compiler", "nothing yet")
    title = f"path {path}, {compiler()}; recorded with {by}"
    table = Table("kernel", "instructions", "recorded", "moved", title=title)
    moved = {}
    for name, value in counts.items():
        before = known.get(name)
        change = value / before - 1 if before else None
        if change is not None and abs(change) > TOLERANCE:
            moved[name] = change
        shown = "new" if change is None else f"{change:+.1%}"
        table.add_row(name, f"{value:,}", f"{before:,}" if before else "", shown)
    Console().print(table)
    if "--record" in sys.argv:
        record[path] = {"compiler": compiler(), "instructions": counts}
        RECORD.write_text(json.dumps(record, indent=1) + "\n")
        return
    for what, names in (
        ("not recorded yet (`make bench-record`)", counts.keys() - known.keys()),
        ("recorded, but no longer there", known.keys() - counts.keys()),
    ):
        if names:
            print(f"{what}: {', '.join(sorted(names))}")
    if moved:
        told = ", ".join(f"{name} by {change:+.1%}" for name, change in moved.items())
        sys.exit(f"moved by more than {TOLERANCE:.0%}: {told}")


if __name__ == "__main__":
    main()
