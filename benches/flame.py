"""Where the time of a Monte Carlo run goes: a flame graph, and the shares of its parts.

    pip install py-spy
    python benches/flame.py [--seconds 10] [--out benches/img/monte_carlo_flame.png]

py-spy samples the stacks of Python and of the extension while a run of bearings repeats on
one thread: simulation, estimates and their statistics. Widths are shares of the samples.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
TRIALS = 20_000
DEEPEST = 9  # levels that are drawn
NOISE = "bearings and their noise (ChaCha8, ziggurat)"
#: What a frame of this name stands for; the first in a stack that has one counts.
PARTS = {
    "simulate": NOISE,
    "normal": NOISE,
    "generate": NOISE,
    "Linearize": "rows and residuals, trials side by side",
    "Triangularize": "rows reduced to a triangle",
    "solve": "starts and steps, trial by trial",
    "Bearings.estimate": "the rest of the estimator",
}


def repeat(seconds: float) -> None:
    """Repeat the run that is looked at."""
    import gramian as gm

    times = np.arange(60) * 10.0
    turned = np.where(times < 300, 0, 5 * (times - 300))
    path = np.stack([turned, np.minimum(5 * times, 1500)], axis=1)
    scene = gm.monte_carlo.Bearings(times, path, [2000.0, 5000.0, -2.0, 1.0], np.radians(0.1))
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        gm.monte_carlo.run(scene, TRIALS, 1, progress=False, workers=1)


def named(frame: str) -> str | None:
    """Return the name of a frame without its place, or None for what only hands on."""
    kernel = re.search(r"Impl<.*?(\w+)(<\d+>)?>+ \(", frame)
    if kernel:
        return kernel[1]
    name = re.sub(r"<.*>", "", frame.rsplit(" (", 1)[0])
    hands_on = name in ("call", "with_simd") or not re.fullmatch(r"[A-Za-z][\w.]*", name)
    return None if hands_on else name


def stacks(seconds: float) -> Counter[tuple[str, ...]]:
    """Sample the stacks of a run, from `monte_carlo.run` on."""
    found: Counter[tuple[str, ...]] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "stacks"
        py_spy = [
            str(Path(sys.executable).with_name("py-spy")),
            "record",
            "--native",
            "--rate",
            "250",
        ]
        work = [sys.executable, __file__, "--repeat", str(seconds)]
        subprocess.run(
            [*py_spy, "--format", "raw", "--output", str(raw), "--", *work],
            check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        for line in raw.read_text().splitlines():
            text, count = line.rsplit(" ", 1)
            frames = text.split(";")
            begins = [i for i, f in enumerate(frames) if "monte_carlo/run.py" in f]
            if begins and "importlib" not in text:  # imports of the first run
                kept = (named(frame) for frame in frames[begins[0] :])
                found[tuple(name for name in kept if name)] += int(count)
    return found


def shares(found: Counter[tuple[str, ...]]) -> dict[str, float]:
    """Return the share of each part of the work; what is left is the machinery's."""
    total = sum(found.values())
    rest = "statistics, and what runs in Python"
    out = dict.fromkeys([*PARTS.values(), rest], 0.0)
    for stack, count in found.items():
        # The outermost of the extension's parts, which are all inside the estimate.
        inside = [PARTS[name] for name in stack if name in PARTS]
        out[(inside[1:] or inside or [rest])[0]] += count / total
    return out


def draw(found: Counter[tuple[str, ...]], path: Path) -> None:
    """Draw the stacks, the root below."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    total = sum(found.values())
    fig, ax = plt.subplots(figsize=(9, 3.2), layout="constrained")
    colours = plt.get_cmap("YlOrRd")

    def level(stacks: Counter[tuple[str, ...]], depth: int, left: float) -> int:
        groups: dict[str, Counter[tuple[str, ...]]] = {}
        for stack, count in stacks.items():
            if stack:
                groups.setdefault(stack[0], Counter())[stack[1:]] += count
        deepest = depth
        for name in sorted(groups):
            width = sum(groups[name].values()) / total
            if width >= 0.002 and depth < DEEPEST:
                shade = colours(0.15 + 0.5 * (sum(map(ord, name)) % 17) / 17)
                ax.barh(depth, width, 0.94, left, color=shade, edgecolor="white", linewidth=0.4)
                room = int(140 * width)
                if room > 3:
                    text = name if len(name) <= room else name[: room - 1] + "…"
                    ax.text(left + 0.002, depth, text, va="center", fontsize=7, clip_on=True)
                deepest = max(deepest, level(groups[name], depth + 1, left))
            left += width
        return deepest

    deepest = level(found, 0, 0.0)
    ax.set(xlim=(0, 1), ylim=(-0.6, deepest - 0.4), yticks=[], xlabel="share of the time")
    ax.xaxis.set_major_formatter(mpl.ticker.PercentFormatter(1.0))
    ax.set_title(f"monte_carlo.run of bearings, {TRIALS} trials on one thread", fontsize=9)
    for side in ("top", "left", "right"):
        ax.spines[side].set_visible(False)
    fig.savefig(path, dpi=110)


def main() -> None:
    """Sample, draw, and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of sampling")
    parser.add_argument("--out", type=Path, default=HERE / "img" / "monte_carlo_flame.png")
    parser.add_argument("--repeat", type=float, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.repeat:
        repeat(asked.repeat)
        return
    found = stacks(asked.seconds)
    draw(found, asked.out)
    for part, share in shares(found).items():
        print(f"{share:6.1%}  {part}")


if __name__ == "__main__":
    main()
