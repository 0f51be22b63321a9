"""Run all contests: python benches/run.py [--quick] [--record] [PART ...].

Each part runs in a fresh process, so that none disturbs another and each has its
own peak of memory. Results are written as they come: benches/results/latest.json (see
benches/schema.json), latest.md and pictures; stopped by Ctrl-C, they hold what is done. `--record`
writes benches/RESULTS.md, its pictures and the versions of the peers (benches/peers.txt) too.
A contestant of your own is one file: benches/contestants/README.md.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import importlib
import importlib.metadata
import json
import math
import os
import platform
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness import HERE, ONE_THREAD, Footprint, Row, against, impossible, markdown, run
from limits import Gauge, larger, measure
from report import document, pictures
from rich.console import Console

RESULTS = HERE / "results"
PEERS = (
    "numpy", "scipy", "numba", "jax", "control", "magpylib", "stonesoup", "pybounds", "gtsam",
    "distributed",
)  # fmt: skip
MARK = "@bench "  # before what a part tells its parent on a line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("parts", nargs="*", help="kernels, spine, bearings, ...; all by default")
    parser.add_argument("--quick", action="store_true", help="fewer rounds, sizes and peers")
    parser.add_argument("--record", action="store_true", help="also write benches/RESULTS.md")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    known = ["kernels", *sorted(path.stem[6:] for path in HERE.glob("bench_*.py"))]
    if wrong := set(options.parts) - set(known):
        parser.error(f"no part is named {', '.join(sorted(wrong))}: they are {', '.join(known)}")
    if options.child:
        part(options.parts[0], quick=options.quick)
        return
    os.environ.update(ONE_THREAD)
    Run(options.parts or known, quick=options.quick, record=options.record).go()


class Run:
    """All parts one after the other; what is done is written at once."""

    def __init__(self, parts: list[str], *, quick: bool, record: bool) -> None:
        self.parts, self.quick, self.record = parts, quick, record
        self.console = Console(soft_wrap=True, highlight=False)
        self.rows: list[Row] = []
        self.limits = measure()
        self.about = describe()
        self.parts_about: dict[str, Any] = {}
        self.start = time.perf_counter()

    def go(self) -> None:
        stopped = False
        try:
            for number, name in enumerate(self.parts):
                self._part(number, name)
        except KeyboardInterrupt:
            stopped = True
            self.about["stopped"] = "before its end"
        self._write(drawn=self._draw(RESULTS))
        if self.record and not stopped:
            drawn = self._draw(HERE / "img")
            self._write(HERE / "RESULTS.md", [f"img/{name}" for name in drawn])
            pinned = {name: peer_version(name) for name in PEERS}
            lines = [f"{name}=={of}\n" for name, of in pinned.items() if of]
            (HERE / "peers.txt").write_text("".join(lines))
        self.console.print(f"written to {RESULTS}")
        if stopped:
            sys.exit(130)
        if wrong := impossible(self.rows):
            names = "; ".join(f"{row.contest}: {row.contestant}" for row in wrong)
            sys.exit(f"faster than what binds them, which is an error of the suite: {names}")

    def _part(self, number: int, name: str) -> None:
        began = time.perf_counter()
        with self.console.status("") as status:
            for told in kernels(quick=self.quick) if name == "kernels" else child(name, self.quick):
                if "contest" in told:
                    minutes = (time.perf_counter() - self.start) / 60
                    line = f"[{number + 1}/{len(self.parts)}] {minutes:.1f} min  {name}: "
                    line += told["contest"]
                    status.update(line)
                    if not self.console.is_terminal:
                        self.console.print(line)
                elif "rows" in told:
                    new = [Row(**row) for row in told["rows"]]
                    self.rows += new
                    self.console.print(markdown(new), markup=False)
                    self._write()
                elif "limits" in told:
                    self.limits = larger(self.limits, told["limits"])
                elif "peak" in told:
                    self.parts_about[name] = {"peak memory, MiB": told["peak"]}
                else:
                    self.console.print(f"{name}: {told['failed']}", markup=False)
                    self.rows.append(
                        Row(name, "whole part", "", 1, part=name, message=told["failed"])
                    )
        about = self.parts_about.setdefault(name, {})
        about["seconds"] = round(time.perf_counter() - began, 1)
        self._write()

    def _draw(self, place: Path) -> list[str]:
        try:
            return pictures(self.rows, place)
        except ImportError as error:
            self.console.print(f"No pictures: {error}", markup=False)
            return []

    def _write(self, path: Path | None = None, drawn: Sequence[str] = ()) -> None:
        """Write what there is; fractions by the rates beside each contest, or the best seen."""
        against(self.rows, self.limits)
        RESULTS.mkdir(exist_ok=True)
        self.about["minutes"] = round((time.perf_counter() - self.start) / 60, 1)
        text = document(self.about, self.limits, self.parts_about, self.rows, drawn)
        (path or RESULTS / "latest.md").write_text(text)
        data = {
            "schema": 1,
            "environment": {name: of for name, of in self.about.items() if name not in PEERS},
            "peers": {name: peer_version(name) for name in PEERS},
            "limits": self.limits,
            "parts": self.parts_about,
            "rows": [asdict(row) for row in self.rows],
        }
        whole = json.dumps(plain(data), indent=1, allow_nan=False)
        (RESULTS / "latest.json").write_text(whole + "\n")


def plain(value: Any) -> Any:
    """Return what JSON can hold: infinities as words."""
    if isinstance(value, dict):
        return {key: plain(of) for key, of in value.items()}
    if isinstance(value, list):
        return [plain(of) for of in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def part(name: str, *, quick: bool) -> None:
    """Run one part in this process and tell the parent of it."""
    # The parent is told too, and stops in order.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

    def tell(**what: Any) -> None:
        print(MARK + json.dumps(what), flush=True)

    limits, gauge = measure(0.03), Gauge()
    tell(limits=limits)
    for contest in importlib.import_module(f"bench_{name}").contests(quick):
        tell(contest=contest.name)
        if isinstance(contest, Footprint):
            rows = contest.run()
        else:
            rows = run(
                contest,
                rounds=3 if quick else 7,
                limits=limits,
                gauge=gauge,
                seconds=0.01 if quick else 0.02,
                patience=0.5 if quick else 4.0,
            )
        for row in rows:
            row.part = name
        tell(rows=[asdict(row) for row in rows])
    tell(peak=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


def child(name: str, quick: bool) -> Iterator[dict[str, Any]]:
    """Yield what a part tells from a process of its own."""
    command = [sys.executable, "-W", "ignore", __file__, "--child", name]
    command += ["--quick"] * quick
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
    ) as process:
        try:
            for line in process.stdout or ():
                if line.startswith(MARK):
                    yield json.loads(line[len(MARK) :])
            last = process.stderr.read().strip().splitlines() if process.stderr else []
        except BaseException:
            process.kill()
            raise
        if process.wait():
            yield {"failed": last[-1] if last else f"ended with status {process.returncode}"}


def kernels(*, quick: bool) -> Iterator[dict[str, Any]]:
    """Yield the timings of `cargo bench`, which are of the crate without Python."""
    yield {"contest": "cargo bench -p gramian --bench kernels"}
    command = ["cargo", "bench", "-p", "gramian", "--bench", "kernels", "--", "--max-time"]
    command += ["0.1" if quick else "1"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=HERE.parent)
    except OSError as error:
        yield {"failed": str(error)}
        return
    rows = []
    units = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}
    time_of = r"([\d.]+) (ns|µs|ms|s)\s+│ "
    for line in done.stdout.splitlines():
        found = re.match(rf"\s+[├╰]─ (\S+)\s+{time_of * 3}", line)
        if found:
            name, *times = found.groups()
            low, _, median = (float(x) * units[u] for x, u in zip(*[iter(times)] * 2, strict=True))
            rows.append(
                asdict(
                    Row(
                        "kernels of the crate, one call", name, "call", 1, part="kernels",
                        minimum=low, median=median,
                        note="Their accuracy is that of the contests below, which call them.",
                    )
                )
            )  # fmt: skip
    yield {"rows": rows} if rows else {"failed": done.stderr.strip().splitlines()[-1]}


def describe() -> dict[str, object]:
    """Return the machine, the versions and the command."""
    about: dict[str, object] = {
        "date": datetime.date.today().isoformat(),
        "command": " ".join(["python benches/run.py", *sys.argv[1:]]),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load at the start": round(os.getloadavg()[0], 2),
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "python": platform.python_version(),
        "gcc": _first_line("gcc", "--version"),
        "rustc": _first_line("rustc", "--version"),
        "commit": _first_line("git", "rev-parse", "--short", "HEAD"),
    }
    for package in ("gramian", *PEERS):
        about[package] = peer_version(package) or "not installed"
    return about


def peer_version(package: str) -> str | None:
    """Return the version of a package, None where it is not installed."""
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        return importlib.metadata.version(package)
    return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    name = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")
    flags = next((line for line in lines if line.startswith("flags")), "").split()
    wide = [flag for flag in ("avx2", "fma", "avx512f") if flag in flags]
    return f"{name} ({', '.join(wide)})" if wide else name


def _first_line(*command: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=HERE)
    except (OSError, subprocess.CalledProcessError):
        return "not found"
    return done.stdout.split("\n")[0]


if __name__ == "__main__":
    main()
