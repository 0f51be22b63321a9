"""How long the command takes: each in a process of its own, beside the import of numpy.

python benches/command_speed.py [RUNS]

Seconds by the clock, of a machine that does nothing else; and of the processor, which a busy
machine changes less.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

HERE = Path(__file__).parents[1]
EASY = str(HERE / "python" / "gramian" / "demo" / "1_easy.toml")


def seconds(arguments: list[str], runs: int) -> tuple[float, float]:
    """The median time of a call of Python, by the clock and of the processor."""
    clock, processor = [], []
    for _ in range(runs):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        clock.append(time.perf_counter() - begin)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return median(clock), median(processor)


def main() -> None:
    """Print a line for each."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    with tempfile.TemporaryDirectory() as out:
        calls = {
            "import numpy": ["-c", "import numpy"],
            "import gramian": ["-c", "import gramian"],
            "gramian analyze": ["-m", "gramian", "analyze", EASY],
            "gramian analyze --out": ["-m", "gramian", "analyze", EASY, "--out", out],
        }
        for arguments in calls.values():
            seconds(arguments, 1)
        taken = {name: seconds(arguments, runs) for name, arguments in calls.items()}
    numpy = taken["import numpy"][1]
    print(f"{'':24s} {'clock':>8s} {'processor':>11s}   beside numpy's import")
    for name, (clock, processor) in taken.items():
        print(f"{name:24s} {clock:6.3f} s {processor:9.3f} s   {processor / numpy:5.2f} x")


if __name__ == "__main__":
    main()
