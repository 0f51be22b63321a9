"""Run all contests and write the tables and pictures: python benches/run.py [--quick] [PART ...].

Writes benches/results/latest.json, latest.md and PNG pictures.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import importlib.metadata
import json
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from harness import HERE, OURS, Row, markdown, run
from limits import measure
from rich.console import Console
from rich.progress import Progress

RESULTS = HERE / "results"
PEERS = (
    "numpy", "scipy", "numba", "jax", "control", "magpylib", "stonesoup", "pybounds", "distributed",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", help="spine, bearings, ...; all by default")
    parser.add_argument(
        "--quick", action="store_true", help="fewer rounds and sizes: under 3 minutes"
    )
    options = parser.parse_args()
    parts = options.parts or sorted(path.stem[6:] for path in HERE.glob("bench_*.py"))
    console = Console()
    limits = measure()
    about = describe(limits)
    rows: list[Row] = []
    with Progress(console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("benchmarks", total=None)
        for part in parts:
            module = importlib.import_module(f"bench_{part}")
            for contest in module.contests(options.quick):
                progress.update(task, description=f"{part}: {contest.name}", advance=1)
                new = run(contest, rounds=3 if options.quick else 9, limits=limits)
                rows += new
                console.print(markdown(new), markup=False, highlight=False, soft_wrap=True)
    about["peak memory, MiB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    RESULTS.mkdir(exist_ok=True)
    growth = slopes(rows)
    data = {"about": about, "limits": limits, "growth": growth, "rows": [asdict(r) for r in rows]}
    (RESULTS / "latest.json").write_text(json.dumps(data, indent=1, default=float))
    (RESULTS / "latest.md").write_text(document(about, growth, rows))
    pictures(rows)
    console.print(f"written to {RESULTS}", highlight=False)


def describe(limits: dict[str, float]) -> dict[str, object]:
    """Return the machine, the versions and the limits."""
    about: dict[str, object] = {
        "date": datetime.date.today().isoformat(),
        "command": "make bench" if "--quick" not in sys.argv else "make bench-quick",
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "gcc": _first_line("gcc", "--version"),
        "rustc": _first_line("rustc", "--version"),
    }
    for package in ("gramian", *PEERS):
        try:
            about[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            about[package] = "not installed"
    about["multiply-adds, G lanes/s"] = round(limits["fma"] / 1e9, 2)
    about["sine and cosine pairs, G/s"] = round(limits["sincos"] / 1e9, 3)
    about["memory, GB/s"] = round(limits["memory"] / 1e9, 1)
    return about


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    name = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")
    flags = next((line for line in lines if line.startswith("flags")), "")
    wide = [flag for flag in ("avx2", "fma", "avx512f") if f" {flag}" in flags]
    return f"{name} ({', '.join(wide)})"


def _first_line(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split(
            "\n"
        )[0]
    except (OSError, subprocess.CalledProcessError):
        return "not found"


def slopes(rows: Sequence[Row]) -> dict[str, float]:
    """Return the slope of log time of a whole call against log size, for each series of ours."""
    found = {}
    for series in dict.fromkeys(row.series for row in rows if row.series):
        ours = [r for r in rows if r.series == series and r.contestant == OURS and r.minimum]
        sizes = [r.size for r in ours]
        if len(set(sizes)) > 1:
            times = [r.minimum for r in ours]
            found[series] = float(np.polyfit(np.log(sizes), np.log(times), 1)[0])
    return found


def document(about: dict[str, object], growth: dict[str, float], rows: Sequence[Row]) -> str:
    """Return the whole run as Markdown."""
    text = "# Benchmarks\n\n"
    text += (
        "One run; contestants take turns within it, so the ratios hold where the machine's speed\n"
    )
    text += "drifts. `x ours` is a contestant's median over ours: above 1, ours is faster.\n\n"
    text += "| | |\n|---|---|\n"
    text += "".join(f"| {key} | {value} |\n" for key, value in about.items())
    if growth:
        text += "\n## Growth\n\nSlope of log time of one unit against log size.\n\n"
        text += "| series | slope |\n|---|---|\n"
        text += "".join(f"| {series} | {slope:.2f} |\n" for series, slope in growth.items())
    return text + "\n## Contests\n" + markdown(rows)


def pictures(rows: Sequence[Row]) -> None:
    """Draw time against size, the fraction of the limit, and speed against accuracy."""
    from gramian.plot import COLORS, figure

    series = [s for s in dict.fromkeys(r.series for r in rows) if s]
    if series:
        fig = figure(5.2 * min(3, len(series)), 3.8 * -(-len(series) // 3))
        panels = fig.subplots(-(-len(series) // 3), min(3, len(series)), squeeze=False).ravel()
        for axes, name in zip(panels, series, strict=False):
            of = [r for r in rows if r.series == name and r.minimum and r.size]
            for contestant in dict.fromkeys(r.contestant for r in of):
                points = [(r.size, r.minimum * 1e6) for r in of if r.contestant == contestant]
                width = 2.5 if contestant == OURS else 1.2
                axes.loglog(*zip(*points, strict=True), "o-", linewidth=width, label=contestant)
            axes.set_title(name, fontsize="medium")
            axes.set_ylabel("us a unit")
            axes.set_xlabel("size")
            axes.legend(fontsize="x-small")
            axes.grid(alpha=0.3, which="both")
        for axes in panels[len(series) :]:
            axes.set_visible(False)
        fig.savefig(RESULTS / "size.png")
    limited = [r for r in rows if r.contestant == OURS and r.fraction]
    if limited:
        fig = figure(8.0, 0.8 + 0.32 * len(limited))
        axes = fig.subplots()
        names = [f"{r.contest} ({r.limit.split(':')[0]})" for r in limited]
        axes.barh(names, [100 * r.fraction for r in limited], color=COLORS["observer"])
        axes.axvline(100, color="black", linewidth=0.8)
        axes.invert_yaxis()
        axes.set_xlabel("% of the limit that binds")
        fig.savefig(RESULTS / "limit.png")
    compared = list(dict.fromkeys(r.contest for r in rows))
    points = []
    for contest in compared:
        for r in rows:
            if r.contest == contest and r.ratio and not r.message:
                errors = [e for e in (r.error, *r.accuracy.values()) if e is not None]
                if errors:
                    points.append((r.contestant, r.ratio, max(*errors, 1e-17)))
    if points:
        fig = figure(7.5, 5.0)
        axes = fig.subplots()
        for contestant in dict.fromkeys(p[0] for p in points):
            of_one = [(ratio, error) for name, ratio, error in points if name == contestant]
            axes.loglog(*zip(*of_one, strict=True), "o", label=contestant)
        axes.set_xlabel("time over ours, same work")
        axes.set_ylabel("relative error, worst case measured")
        axes.legend(fontsize="x-small", ncols=2)
        axes.grid(alpha=0.3)
        fig.savefig(RESULTS / "accuracy.png")


if __name__ == "__main__":
    main()
