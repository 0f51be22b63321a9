"""The tables of Xu et al. 2009: every printed figure but three named misprints."""

import json

import pytest

from gramian.reproduce import PAPERS, reproduce, xu_2009


def test_every_printed_figure_is_equal_or_a_named_misprint():
    ours = xu_2009.computed()
    off = {}
    for label, laws in xu_2009.PRINTED.items():
        for law, printed in laws.items():
            for k, figure, value in zip(xu_2009.SAMPLES, printed, ours[label][law], strict=True):
                if figure != f"{value:.4f}":
                    off[label, law, k] = f"{value:.4f}"
    assert off == xu_2009.NAMED
    assert len(off) == 3


def test_report_says_so():
    assert "xu-2009" in PAPERS
    report = reproduce("xu-2009")
    assert report.headline == "REPRODUCED"
    assert report.verdict.startswith("27 of 30 printed figures")
    data = json.loads(report.to_json())
    assert len(data["misprints"]) == 3
    assert [p.title for p in report.pictures] == [f"Figure {i}" for i in range(5, 13)]


@pytest.mark.parametrize("index", [0, 2, 5])
def test_figures_draw(index):
    figure = reproduce("xu-2009").pictures[index].draw()
    assert figure.axes[0].lines
