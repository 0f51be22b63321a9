"""Build the explorer: python explorer/build.py [--or-say-why] [PAGE]

Compiles the crate `rust/gramian-explorer` to WebAssembly and puts it, with the style and the
script, into one page that opens from a folder, by default site/explorer.html. Where the
target is missing it says how to get it and exits with 3; with --or-say-why, for the site, it
writes a page that says so.
"""

import base64
import gzip
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
TARGET = "wasm32-unknown-unknown"
MISSING = f"the explorer needs the Rust target {TARGET}: rustup target add {TARGET}"


def target_is_there() -> bool:
    """Say whether the target's standard library is installed."""
    try:
        ask = ["rustc", "--print", "target-libdir", "--target", TARGET]
        said = subprocess.run(ask, capture_output=True, text=True, check=True, cwd=ROOT)
    except (OSError, subprocess.CalledProcessError):
        return False
    return any(Path(said.stdout.strip()).glob("libstd-*"))


def build(page: Path) -> Path:
    """Write the page."""
    profile, crate = "explorer", "gramian-explorer"
    run = ["cargo", "build", "--quiet", "-p", crate, "--target", TARGET, "--profile", profile]
    subprocess.run(run, cwd=ROOT, check=True)
    wasm = (ROOT / "target" / TARGET / profile / "gramian_explorer.wasm").read_bytes()
    text = (ROOT / "explorer/index.html").read_text(encoding="utf-8")
    parts = {
        "/*STYLE*/": (ROOT / "explorer/explorer.css").read_text(encoding="utf-8"),
        "/*WASM*/": base64.b64encode(wasm).decode(),
        "/*SCRIPT*/": (ROOT / "explorer/explorer.js").read_text(encoding="utf-8"),
    }
    for mark, part in parts.items():
        text = text.replace(mark, part)
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text, encoding="utf-8")
    size = len(gzip.compress(wasm, 9)) / 1000
    print(f"{page}: WebAssembly of {size:.0f} kB compressed")
    return page


def main(arguments: list[str]) -> int:
    """Build the page, or say what is missing."""
    pages = [Path(text) for text in arguments if not text.startswith("--")]
    page = pages[0] if pages else ROOT / "site/explorer.html"
    if target_is_there():
        build(page)
        return 0
    print(MISSING, file=sys.stderr)
    if "--or-say-why" not in arguments:
        return 3
    page.parent.mkdir(parents=True, exist_ok=True)
    title = "<!doctype html><meta charset=utf-8><title>gramian explorer</title>"
    page.write_text(f"{title}<p>Not built: {MISSING}</p>\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
