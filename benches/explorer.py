"""How long the explorer takes to answer a drag: python benches/explorer.py PAGE

PAGE is what `make explorer` built (site/explorer.html). For each example of the first tab with
100 bearings, and for the other tabs, the milliseconds of computation of
- the answer: verdict, null direction, bounds, bound against time;
- a drag, all that it shows at once: the answer, the next heading, the regions roughly;
- the rest, beside it in a worker: regions and intervals to the library's last digits;
and of drawing a drag, which is no computation: median and least of 15 in headless Chromium, and
how far the rough regions are from the others, as a share of their width. Needs playwright and
Chromium.
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
  const all = (asked) => {
    const answers = Object.entries(asked).map(([k, one]) => [k, explorer.ask(...one)]);
    return Object.fromEntries(answers);
  };
  // How far a point is from a piece of a curve.
  const far = (p, a, b, wide) => {
    const [u, v] = [a, b].map((q) => q.map((x, i) => (x - p[i]) / wide[i]));
    const d = [v[0] - u[0], v[1] - u[1]], size = d[0] ** 2 + d[1] ** 2;
    const share = size ? Math.min(1, Math.max(0, -(u[0] * d[0] + u[1] * d[1]) / size)) : 0;
    return Math.hypot(u[0] + share * d[0], u[1] + share * d[1]);
  };
  // The farthest of the rough points from the other curve, in widths of that.
  const apart = (rough, fine) => Math.max(0, ...rough.map(({ points }, k) => {
    const curve = fine[k].points, at = (i) => curve.map((p) => p[i]);
    const wide = [0, 1].map((i) => Math.max(...at(i)) - Math.min(...at(i)));
    const off = (p) => Math.min(...curve.slice(1).map((q, j) => far(p, curve[j], q, wide)));
    return Math.max(...points.map(off));
  }));
  const add = (name, model, scene) => {
    const later = model === track ? model.later(scene, model.analyze(scene)) : {};
    const drag = () => {
      const answer = model.analyze(scene);
      return model.gather(scene, answer, all(model.soon(scene, answer)));
    };
    explorer.scenes[explorer.tab] = scene;
    const shown = model === explorer.models[explorer.tab];
    const drawing = shown ? timed(() => explorer.show(false)) : [0, 0];
    const rough = drag().regions, fine = model.gather(scene, null, all(later)).regions;
    const said = !rough ? "" : rough.length !== fine.length ? "lost a piece"
      : `${(100 * apart(rough, fine)).toFixed(2)} %`;
    const times = [() => model.analyze(scene), drag, () => all(later)].flatMap(timed);
    out.push([name, ...times, ...drawing, said]);
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
    heads = ("answer", "drag", "rest, in a worker", "drawing", "rough by")
    print(f"{'ms, median (least)':34s}" + "".join(f"{head:>18s}" for head in heads))
    for name, *times, apart in rows:
        cells = [
            f"{middle:.1f} ({least:.1f})" if middle > 0.05 else ""
            for middle, least in zip(times[::2], times[1::2], strict=True)
        ]
        print(f"{name:34s}" + "".join(f"{cell:>18s}" for cell in (*cells, apart)))


if __name__ == "__main__":
    main()
