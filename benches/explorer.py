"""How long the explorer takes to answer a drag: python benches/explorer.py PAGE

PAGE is what `make explorer` built (site/explorer.html). For each example of the first tab with
100 bearings, and for the other tabs, the milliseconds of the answer at once (verdict, null
direction, bounds, bound against time) and, beside it in a worker, of the regions, intervals and
headings: median and least of 15 in headless Chromium. Needs playwright and Chromium.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

TIMES = """() => {
  const timed = (f) => {
    const all = Array.from({ length: 15 }, () => {
      const began = performance.now();
      f();
      return performance.now() - began;
    });
    all.sort((a, b) => a - b);
    return [all[7], all[0]];
  };
  const out = [], { track, dipole, radars } = explorer.models;
  const add = (name, model, scene) => {
    const answer = model.analyze(scene);
    const later = model === track ? model.later(scene, answer) : [];
    const rest = () => later.forEach((one) => explorer.ask(...one));
    out.push([name, ...timed(() => model.analyze(scene)), ...timed(rest)]);
  };
  for (const [name, preset] of Object.entries(track.presets)) {
    const scene = { ...track.start(), ...structuredClone(preset), count: 100 };
    if (!preset.times) add(name, track, scene);
  }
  const use = { bearing: true, range: true, frequency: true };
  add("three sensors, 300 measurements", track, { ...track.start(), use, count: 100 });
  add("dipole, two sensors, 100 samples", dipole, { ...dipole.start(), two: true, count: 100 });
  add("two radars, 100 looks", radars, radars.start());
  return out;
}"""


def main() -> None:
    """Print the table."""
    page = Path(sys.argv[1] if len(sys.argv) > 1 else "site/explorer.html").resolve()
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.goto(page.as_uri())
        tab.wait_for_function("window.explorer && explorer.ready && explorer.calm")
        rows = tab.evaluate(TIMES)
        browser.close()
    print(f"{'ms, median (least)':36s}{'at once':>18s}{'in the worker':>18s}")
    for name, at_once, best, later, least in rows:
        beside = f"{later:.1f} ({least:.1f})" if later > 0.05 else ""
        print(f"{name:36s}{f'{at_once:.1f} ({best:.1f})':>18s}{beside:>18s}")


if __name__ == "__main__":
    main()
