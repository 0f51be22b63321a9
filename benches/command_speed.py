"""How long the command takes: each in a process of its own, beside the import of numpy.

python benches/command_speed.py [RUNS]
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

HERE = Path(__file__).parents[1]
EASY = str(HERE / "python" / "gramian" / "demo" / "1_easy.toml")


def seconds(arguments: list[str], runs: int) -> float:
    """The median time of a call of Python."""
    taken = []
    for _ in range(runs):
        begin = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        taken.append(time.perf_counter() - begin)
    return median(taken)


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
    for name, value in taken.items():
        print(f"{name:24s} {value:6.3f} s   {value / taken['import numpy']:5.2f} x numpy's import")


if __name__ == "__main__":
    main()
