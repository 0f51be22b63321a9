"""
Three ships
===========

Three observers take a bearing every 15 s. Every plain filter reports a position for all three;
only one of them has earned it.
"""

from importlib.resources import files
from pathlib import Path

import gramian as gm
from gramian.models.bearings.plot import draw_geometry
from gramian.plot import COLORS, figure
from gramian.scenario import load

picture = figure(9.6, 4.5)
panels = picture.subplots(1, 3)
for axes, name in zip(panels, ("1_easy", "2_hopeless", "3_impossible"), strict=True):
    scenario = load(Path(str(files("gramian") / "demo" / f"{name}.toml")))
    report = scenario.analyze()
    print(report.headline)
    draw_geometry(scenario.geometry, gm.analyze(scenario.problem), axes)
    color = {"good": COLORS["good"], "weak": COLORS["weak"], "bad": COLORS["bad"]}[report.tone]
    axes.set_title(report.headline, color=color, fontweight="bold")
    lines, labels = axes.get_legend_handles_labels()
    labels = [text.replace(", half axis", ",\nhalf axis") for text in labels]
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.22), "fontsize": "small"}
    axes.legend(lines, labels, frameon=False, **below)
