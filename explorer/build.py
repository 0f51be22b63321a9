"""Build the explorer: python explorer/build.py [--or-say-why] [PAGE ...]

Compiles the crate `rust/gramian-explorer` to WebAssembly and puts it, with the style and the
scripts, into one page that opens from a folder: by default site/explorer.html, and
python/gramian/explorer/page.html, which wheels carry for `gramian explore` and `gm.explore`.
Where the target is missing it says how to get it and exits with 3; with --or-say-why, for the
site, it writes a page that says so.
"""

import base64
import csv
import gzip
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
HERE = ROOT / "explorer"
PAGES = (ROOT / "site/explorer.html", ROOT / "python/gramian/explorer/page.html")
TARGET = "wasm32-unknown-unknown"
MISSING = f"the explorer needs the Rust target {TARGET}: rustup target add {TARGET}"
#: Scripts of the page, in the order in which they are read.
SCRIPTS = ("words", "csv", "track", "dipole", "radars", "picture", "background", "page")


def target_is_there() -> bool:
    """Say whether the target's standard library is installed."""
    try:
        ask = ["rustc", "--print", "target-libdir", "--target", TARGET]
        said = subprocess.run(ask, capture_output=True, text=True, check=True, cwd=ROOT)
    except (OSError, subprocess.CalledProcessError):
        return False
    return any(Path(said.stdout.strip()).glob("libstd-*"))


def demo() -> dict[str, object]:
    """Return the ships of `gramian demo` as scenes: recorded paths, straight targets."""
    folder, scenes = ROOT / "python/gramian/demo", {}
    for path in sorted(folder.glob("*.toml")):
        scenario = tomllib.loads(path.read_text(encoding="utf-8"))
        tracks, window = scenario["tracks"], scenario["window"]
        ships: dict[str, list[list[float]]] = {}
        with (folder / tracks["file"]).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                names = [tracks["columns"][key] for key in ("time", "east", "north")]
                ships.setdefault(row[tracks["columns"]["id"]], []).append(
                    [float(row[k]) for k in names]
                )
        first, last = window["start"], window["start"] + window["duration"]
        count = round(window["duration"] / window["step"]) + 1
        times = [first + k * window["step"] for k in range(count)]
        own = ships[tracks["observer"]]
        inside = [report for report in own if first < report[0] < last]
        way = [[first, *at(own, first)], *inside, [last, *at(own, last)]]
        if "target" in scenario:
            target = [scenario["target"][key] for key in ("x0", "y0", "vx", "vy")]
        else:
            target = straight(times, [at(ships[tracks["target"]], t) for t in times])
        names = [tracks["observer"], tracks.get("target", "a ship")]
        label = f"Demo: {' and '.join(name.replace('_', ' ') for name in names)}"
        scenes[label] = {
            "path": [point[1:] for point in way],
            "at": [point[0] for point in way],
            "times": times,
            "target": target,
            "sigma": {"bearing": scenario["noise"]["bearing_deg"], "range": 25, "frequency": 0.02},
        }
    return scenes


def at(reports: list[list[float]], time: float) -> list[float]:
    """Return the place between two reports."""
    after = next(k for k, report in enumerate(reports) if report[0] >= time and k)
    (t0, *a), (t1, *b) = reports[after - 1], reports[after]
    share = (time - t0) / (t1 - t0)
    return [round(x + share * (y - x), 3) for x, y in zip(a, b, strict=True)]


def straight(times: list[float], places: list[list[float]]) -> list[float]:
    """Return the straight track through places by least squares: place at first, velocity."""
    middle = sum(times) / len(times)
    spread = sum((t - middle) ** 2 for t in times)
    out = []
    for axis in range(2):
        mean = sum(place[axis] for place in places) / len(places)
        slope = (
            sum((t - middle) * place[axis] for t, place in zip(times, places, strict=True)) / spread
        )
        out.append((mean + slope * (times[0] - middle), slope))
    return [round(out[0][0], 2), round(out[1][0], 2), round(out[0][1], 5), round(out[1][1], 5)]


def build(*pages: Path) -> Path:
    """Write the page, and give the first of its places."""
    profile, crate = "explorer", "gramian-explorer"
    run = ["cargo", "build", "--quiet", "-p", crate, "--target", TARGET, "--profile", profile]
    subprocess.run(run, cwd=ROOT, check=True)
    wasm = (ROOT / "target" / TARGET / profile / "gramian_explorer.wasm").read_bytes()
    read = {name: (HERE / f"{name}.js").read_text(encoding="utf-8") for name in SCRIPTS}
    parts = {
        "/*STYLE*/": (HERE / "explorer.css").read_text(encoding="utf-8"),
        "/*WASM*/": base64.b64encode(wasm).decode(),
        "/*DEMO*/": json.dumps(demo()),
        "/*WORKER*/": (HERE / "worker.js").read_text(encoding="utf-8"),
        "/*LIBRARY*/": (HERE / "library.js").read_text(encoding="utf-8"),
        "/*SCRIPT*/": '"use strict";\n' + "\n".join(read.values()),
    }
    text = (HERE / "index.html").read_text(encoding="utf-8")
    for mark, part in parts.items():
        text = text.replace(mark, part)
    for page in pages:
        page.parent.mkdir(parents=True, exist_ok=True)
        # Whole at any moment: tests of several processes build and read it.
        part = page.with_name(f"{page.name}.{os.getpid()}")
        part.write_text(text, encoding="utf-8")
        part.replace(page)
    size = len(gzip.compress(wasm, 9)) / 1000
    whole = len(gzip.compress(text.encode(), 9)) / 1000
    print(f"{pages[0]}: WebAssembly of {size:.0f} kB compressed, the page {whole:.0f} kB")
    return pages[0]


def main(arguments: list[str]) -> int:
    """Build the page, or say what is missing."""
    pages = [Path(text) for text in arguments if not text.startswith("--")] or list(PAGES)
    if target_is_there():
        build(*pages)
        return 0
    print(MISSING, file=sys.stderr)
    if "--or-say-why" not in arguments:
        return 3
    pages[0].parent.mkdir(parents=True, exist_ok=True)
    title = "<!doctype html><meta charset=utf-8><title>gramian explorer</title>"
    pages[0].write_text(f"{title}<p>Not built: {MISSING}</p>\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
