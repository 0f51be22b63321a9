"""The tables and pictures of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from harness import OURS, Row, markdown
from limits import KINDS, Rates

#: One colour and mark a kind of contestant, the same in every picture.
STYLES = (
    ("gramian", "#0b5fa5", "o"),
    ("C", "#d1495b", "s"),
    ("numba", "#2e8b57", "^"),
    ("JAX", "#8a5a00", "v"),
    ("numpy", "#8d6cab", "D"),
    ("SciPy", "#e08e0b", "P"),
    ("python-control", "#3d3d3d", "X"),
    ("magpylib", "#c2185b", "<"),
    ("Stone Soup", "#00838f", ">"),
    ("pybounds", "#6d4c41", "*"),
)


def family(contestant: str) -> str:
    """Return the software a contestant stands for, or ""."""
    for name, *_ in STYLES:
        if name == "C":
            if contestant == "C" or contestant.startswith(("C,", "C ")):
                return name
        elif name.lower() in contestant.lower():
            return name
    return ""


def growth(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return slopes of log time of a whole call against log size: by series and contestant.

    The slope is that of the upper half of the sizes, where fixed costs no longer show.
    """
    found: dict[str, dict[str, float]] = {}
    for series in dict.fromkeys(row.series for row in rows if row.series):
        of = [row for row in rows if row.series == series and row.minimum and row.size]
        whole = {row.size: row.work for row in of if row.contestant == OURS}
        for contestant in dict.fromkeys(row.contestant for row in of):
            points = sorted(
                (r.size, r.minimum * whole[r.size]) for r in of if r.contestant == contestant
            )
            points = points[len(points) // 2 - 1 :] if len(points) > 2 else points
            if len({size for size, _ in points}) > 1:
                sizes, times = np.log(points).T
                found.setdefault(series, {})[contestant] = float(np.polyfit(sizes, times, 1)[0])
    return found


def document(
    about: dict[str, object],
    limits: Rates,
    parts: dict[str, Any],
    rows: Sequence[Row],
    beside: str = "",
) -> str:
    """Return the whole run as Markdown; `beside` is where its pictures are."""
    text = "# Benchmarks\n\n"
    text += f"Written by `{about['command']}`. All contestants of a table take turns within the\n"
    text += "run, on the same data, so the ratios hold where the machine's speed drifts. `x ours`\n"
    text += "is a contestant's median over ours: above 1, ours is faster. Errors are relative,\n"
    text += "against 50-digit arithmetic; *no digit* is an error of one or more. *Of the limit*:\n"
    text += (
        "the time that the operations of the method take at the rates below, over the time taken.\n"
    )
    text += f"\n![Speed against accuracy]({beside}accuracy.png)\n"
    text += f"\n![Fraction of the limit]({beside}limit.png)\n"
    text += f"\n![Time against size]({beside}size.png)\n"
    text += "\n## Machine and versions\n\n| | |\n|---|---|\n"
    text += "".join(f"| {key} | {value} |\n" for key, value in about.items())
    text += "\n## The machine's limits\n\nMeasured in the run, G a second.\n\n"
    text += "| what | one thread | all |\n|---|---|---|\n"
    for kind, meaning in KINDS.items():
        one, together = (limits[threads][kind] / 1e9 for threads in ("one", "all"))
        text += f"| {kind}: {meaning} | {one:.3g} | {together:.3g} |\n"
    text += worst(rows)
    if slopes := growth(rows):
        text += (
            "\n## Growth\n\nSlope of log time of a call against log size, at the larger sizes.\n\n"
        )
        text += "| series | gramian | others |\n|---|---|---|\n"
        for series, of in slopes.items():
            others = [f"{name} {slope:.2f}" for name, slope in of.items() if name != OURS]
            text += f"| {series} | {of.get(OURS, float('nan')):.2f} | {'; '.join(others)} |\n"
    if parts:
        text += "\n## Parts\n\nEach in a process of its own.\n\n"
        text += "| part | seconds | peak memory, MiB |\n|---|---|---|\n"
        for name, of in parts.items():
            text += f"| {name} | {of.get('seconds', '')} | {of.get('peak memory, MiB', '')} |\n"
    for name in dict.fromkeys(row.part for row in rows):
        text += f"\n## {name}\n" + markdown(row for row in rows if row.part == name)
    return text


def worst(rows: Sequence[Row]) -> str:
    """Return who is faster than we are, and what did not run."""
    text = ""
    ahead = [
        row
        for row in rows
        if row.ratio and row.ratio < 0.95 and OURS not in row.contestant and not row.message
    ]
    # Another question, or one answered with fewer digits, is not the same work.
    same = [row for row in ahead if not row.contestant.startswith(("law ", "nothing"))]
    if same:
        text += "\n## Where others are faster\n\n| contest | contestant | x ours | error |\n"
        text += "|---|---|---|---|\n"
        for row in sorted(same, key=lambda row: row.ratio or 0):
            errors = ", ".join(f"{case} {error:.0e}" for case, error in row.errors.items())
            text += f"| {row.contest} | {row.contestant} | {row.ratio:.2f} | {errors} |\n"
    missing = [row for row in rows if row.message]
    if missing:
        text += "\n## Not run\n\n| contest | contestant | message |\n|---|---|---|\n"
        for row in missing:
            message = row.message.replace("|", "\\|")
            text += f"| {row.contest} | {row.contestant} | {message} |\n"
    return text


def pictures(rows: Sequence[Row], place: Path) -> None:
    """Draw time against size, the fraction of the limit, and speed against accuracy."""
    place.mkdir(exist_ok=True)
    for name in ("size.png", "limit.png", "accuracy.png"):
        (place / name).unlink(missing_ok=True)  # of another run
    _size(rows, place / "size.png")
    _limit(rows, place / "limit.png")
    _accuracy(rows, place / "accuracy.png")


def _figure(width: float, height: float) -> Any:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    return Figure((width, height), dpi=110, layout="constrained")


def _size(rows: Sequence[Row], path: Path) -> None:
    series = [name for name in dict.fromkeys(row.series for row in rows) if name]
    series = [
        name for name in series if len({r.size for r in rows if r.series == name and r.minimum}) > 1
    ]
    if not series:
        return
    columns = min(2, len(series))
    lines = -(-len(series) // columns)
    fig = _figure(6.4 * columns, 2.6 * lines)
    panels = fig.subplots(lines, columns, squeeze=False).ravel()
    for axes, name in zip(panels, series, strict=False):
        _panel(axes, name, [r for r in rows if r.series == name and r.minimum and r.size])
    for axes in panels[len(series) :]:
        axes.set_visible(False)
    fig.savefig(path)


def _panel(axes: Any, name: str, rows: Sequence[Row]) -> None:
    """Draw one series: calls that do the whole work, against size."""
    whole = {row.size: row.work for row in rows if row.contestant == OURS}
    dashes: dict[str, int] = {}
    for contestant in dict.fromkeys(row.contestant for row in rows):
        points = sorted(
            ((row.size or 0), (row.minimum or 0) * whole[row.size] * 1e6)
            for row in rows
            if row.contestant == contestant
        )
        if len(points) < 2:
            continue
        style = next((s for s in STYLES if s[0] == family(contestant)), ("", "grey", "."))
        count = dashes[style[0]] = dashes.get(style[0], -1) + 1
        axes.loglog(
            *zip(*points, strict=True),
            marker=style[2],
            color=style[1],
            linestyle=("-", "--", ":", "-.")[count % 4],
            linewidth=2.4 if contestant == OURS else 1.2,
            markersize=4.5,
            label=contestant,
        )
    axes.set_title(name, fontsize=9.5, loc="left")
    from matplotlib.ticker import NullLocator

    sizes = sorted({row.size or 0 for row in rows})
    axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("us a call")
    axes.set_xlabel(name.rsplit("against ", 1)[-1])
    axes.legend(fontsize=7.5, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.02))
    axes.grid(alpha=0.25, which="major")


def _limit(rows: Sequence[Row], path: Path) -> None:
    limited = [
        row
        for row in rows
        if row.contestant == OURS
        and row.fraction
        and (not row.series or (row.series.startswith("sum") and not _seen(row, rows)))
    ]
    if not limited:
        return
    fig = _figure(9.0, 0.9 + 0.36 * len(limited))
    axes = fig.subplots()
    for place, row in enumerate(limited):
        others = [
            (100 * r.fraction, r)
            for r in rows
            if r.contest == row.contest and r.fraction and r.threads == 1 and family(r.contestant)
        ]
        axes.barh(place, 100 * (row.fraction or 0), color="#0b5fa5", height=0.62)
        for value, other in others:
            name, color, mark = next(s for s in STYLES if s[0] == family(other.contestant))
            if name != "gramian" and value > 0.5:
                axes.plot(value, place, mark, color=color, markersize=5.5, markeredgecolor="white",
                          markeredgewidth=0.5, label=name)  # fmt: skip
        words = f"{row.fraction or 0:.0%} of {row.limit.split(':')[0]}"
        axes.text(110, place, words, va="center", fontsize=8, color="#0b5fa5")
    axes.set_yticks(range(len(limited)), [row.contest for row in limited], fontsize=7.5)
    axes.axvline(100, color="black", linewidth=0.8)
    axes.set_xlim(0, 108)
    axes.text(110, -1.0, "gramian", fontsize=8, fontweight="bold", color="#0b5fa5")
    axes.invert_yaxis()
    axes.set_xlabel("% of the limit, one thread; bars: gramian")
    seen = dict(zip(*_legend(axes), strict=True))
    if seen:
        fig.legend(
            seen.values(), seen.keys(), fontsize=8, ncols=len(seen), frameon=False,
            loc="outside lower center",
        )  # fmt: skip
    fig.savefig(path)


def _legend(axes: Any) -> tuple[list[str], list[Any]]:
    handles, labels = axes.get_legend_handles_labels()
    return labels, handles


def _seen(row: Row, rows: Iterable[Row]) -> bool:
    """Whether a row of a series is not its largest."""
    return any(r.series == row.series and (r.size or 0) > (row.size or 0) for r in rows)


def _accuracy(rows: Sequence[Row], path: Path) -> None:
    cases = ("well", "ill")
    fig = _figure(10.0, 4.6)
    panels = fig.subplots(1, 2, sharey=True)
    drawn = False
    for axes, case in zip(panels, cases, strict=True):
        for name, color, mark in STYLES:
            points = [
                (row.ratio, min(max(row.errors[case] or 0, 1e-17), 10.0))
                for row in rows
                if family(row.contestant) == name
                and row.ratio
                and row.threads == 1
                and row.errors.get(case) is not None
                and (not row.series or not _seen(row, rows))
                and (name != "gramian" or row.contestant == OURS)
            ]
            if points:
                drawn = True
                axes.loglog(
                    *zip(*points, strict=True), mark, color=color, markersize=6, alpha=0.75,
                    markeredgecolor="white", markeredgewidth=0.4, label=name,
                )  # fmt: skip
        axes.axhspan(1, 30, color="#d1495b", alpha=0.08)
        axes.text(0.99, 2.2, "no digit left", ha="right", fontsize=8, color="#8c2f3b",
                  transform=axes.get_yaxis_transform())  # fmt: skip
        axes.axvline(1, color="#0b5fa5", linewidth=0.8, alpha=0.6)
        axes.set_title(f"{case}-conditioned case of each contest", fontsize=9.5)
        axes.set_xlabel("time over ours for the same work (right: slower)")
        axes.set_ylim(5e-18, 30)
        axes.grid(alpha=0.25)
    panels[0].set_ylabel("relative error (below: better)")
    if not drawn:
        return
    labels, handles = [], []
    for axes in panels:
        for label, handle in zip(*_legend(axes), strict=True):
            if label not in labels:
                labels.append(label)
                handles.append(handle)
    fig.legend(handles, labels, fontsize=8, ncols=len(labels), loc="outside lower center",
               frameon=False)  # fmt: skip
    fig.savefig(path)
