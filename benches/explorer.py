"""Time the explorer's page in Chromium: python benches/explorer.py [PAGE]

Prints, for scenes of 100 bearings and for the other tabs, how long a drag takes on the page
(the answer, and drawing it) and how long what follows takes in the worker; and when the first
answer was there. PAGE is site/explorer.html by default; needs playwright and Chromium.
"""

import json
import shutil
import statistics
import sys
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

SCENES = {
    "a turn": "track:A turn",
    "a slight turn": "track:A slight turn: weak",
    "straight": "track:Straight: unobservable",
    "straight, ranges": "track:Straight, with ranges",
    "long range, weak": "track:A slight turn: weak",
    "dipole": "dipole:",
    "radars": "radars:",
}
# Forty drags of the target, a frame apart, as a hand makes them.
DRAG = """async () => {
  const explorer = window.explorer, tab = explorer.tab, scene = explorer.scenes[tab];
  const took = [], drew = [], late = [];
  const look = (go) => (explorer.calm ? go() : setTimeout(look, 5, go));
  const calm = () => new Promise(look);
  await calm();
  const handle = () => explorer.models[tab].handles(scene).find((one) => one.kind === "target");
  for (let k = 0; k < 40; k++) {
    const { at, move } = handle();
    const size = 0.002 * Math.hypot(...at);
    move(at[0] + size * Math.cos(k), at[1] + size * Math.sin(k));
    explorer.update();
    took.push(explorer.took); drew.push(explorer.drew);
    await new Promise(requestAnimationFrame);
    if (explorer.tookMore) late.push(explorer.tookMore);
  }
  await calm();
  late.push(explorer.tookMore);
  return { took, drew, late };
}"""
# A hundred bearings, of a target that is far away or not.
HUNDRED = """(far) => {
  const scene = explorer.scenes.track;
  scene.count = 100;
  if (far) { scene.target = [30000, 42000, -3, 1.2]; scene.sigma.bearing = 0.5; }
  explorer.update({ controls: true });
}"""


def main():
    page_file = Path(sys.argv[1] if len(sys.argv) > 1 else "site/explorer.html").resolve()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        began = time.perf_counter()
        page.goto(page_file.as_uri())
        page.wait_for_function("window.explorer && explorer.ready")
        print(
            f"first answer {page.evaluate('explorer.first'):.0f} ms after navigation began, "
            f"{1e3 * (time.perf_counter() - began):.0f} ms as seen from outside"
        )
        heads = " ".join(f"{text:>16}" for text in ("answer ms", "with drawing", "in the worker"))
        print(f"{'scene':18} {heads}   median, largest")
        for name, what in SCENES.items():
            tab, _, example = what.partition(":")
            page.evaluate(f"explorer.openTab({json.dumps(tab)})")
            if example:
                page.select_option("#control-0", example)
                page.evaluate(HUNDRED, name.startswith("long range"))
            found = page.evaluate(DRAG)
            cells = [
                f"{statistics.median(v):7.2f} {max(v):8.2f}"
                for v in (found["took"], found["drew"], found["late"])
            ]
            print(f"{name:18} " + " ".join(cells))
        browser.close()


if __name__ == "__main__":
    main()
