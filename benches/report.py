"""The tables and pictures of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from harness import OURS, Row, impossible, markdown, percent, seconds
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


PICTURES = {
    "accuracy.png": "Speed against accuracy",
    "limit.png": "Fraction of the limit",
    "size.png": "Time against size",
}


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

    The slope is that of the last factor of ten, where fixed costs no longer show.
    """
    found: dict[str, dict[str, float]] = {}
    for series in dict.fromkeys(row.series for row in rows if row.series):
        of = [row for row in rows if row.series == series and row.minimum and row.size]
        whole = {row.size: row.work for row in of if row.contestant == OURS}
        for contestant in dict.fromkeys(row.contestant for row in of):
            points = sorted(
                (r.size, r.minimum * whole[r.size]) for r in of if r.contestant == contestant
            )
            points = [(size, time) for size, time in points if size >= points[-1][0] / 10]
            if len(points) > 1:
                sizes, times = np.log(points).T
                found.setdefault(series, {})[contestant] = float(np.polyfit(sizes, times, 1)[0])
    return found


def shares(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return what makes up our time, of kernels with a series against trials and samples.

    Seconds of a call, of a trial and of a sample besides, from the times of 10 and 1000
    trials and of 100 and 1000 samples; the fraction of its limit that a sample reaches; the
    time of a trial of 50 samples among 10 000, and what of it that sum leaves: numbers that
    the caches no longer hold.
    """
    found = []
    ours = [row for row in rows if row.contestant == OURS and row.minimum and row.size]
    for name in dict.fromkeys(row.series.removesuffix(" against trials") for row in ours):
        of = {
            kind: {row.size: row for row in ours if row.series == f"{name} against {kind}"}
            for kind in ("trials", "samples")
        }
        if not {10, 1000, 10_000} <= of["trials"].keys() or not {100, 1000} <= of["samples"].keys():
            continue
        few, many, most = (of["trials"][size].minimum or 0.0 for size in (10, 1000, 10_000))
        short, long = (of["samples"][size].minimum or 0.0 for size in (100, 1000))
        call = (few - many) / (1 / 10 - 1 / 1000)
        sample = (long - short) / 900
        # Their trials are a hundred.
        trial = short - call / 100 - 100 * sample
        limit = (of["samples"][1000].fraction or 0.0) * long / 1000
        found.append(
            {
                "kernel": name,
                "call": call,
                "trial": trial,
                "sample": sample,
                "of the limit": limit / sample,
                "among 10 000": most,
                "beyond the caches": most - trial - 50 * sample - call / 10_000,
            }
        )
    return found


INTRODUCTION = """# Benchmarks

Written by `{command}`. All contestants of a table take turns within the run, on the same
data, so the ratios hold where the machine's speed drifts. `x ours` is a contestant's median
over ours, or over that of ours named beside it: above 1, ours is faster. Errors are relative
if nothing else is said, against arithmetic of 30 to 60 digits; *no digit* is an error of one
or more. *Of the limit*: the time that the operations of the method take at the rates measured
in turn with the contestants, over the time taken.
"""


def document(
    about: dict[str, object],
    limits: Rates,
    parts: dict[str, Any],
    rows: Sequence[Row],
    drawn: Sequence[str] = (),
) -> str:
    """Return the whole run as Markdown; `drawn` are the paths of its pictures."""
    text = INTRODUCTION.format(**about)
    for path in drawn:
        text += f"\n![{PICTURES[Path(path).name]}]({path})\n"
    text += "\n## Machine and versions\n\n| | |\n|---|---|\n"
    text += "".join(f"| {key} | {value} |\n" for key, value in about.items())
    if limits:
        text += "\n## The machine's limits\n\nThe best of the run, G a second.\n\n"
        text += "| what | one thread | all |\n|---|---|---|\n"
        for kind, meaning in KINDS.items():
            one, together = (limits[threads][kind] / 1e9 for threads in ("one", "all"))
            text += f"| {kind}: {meaning} | {one:.3g} | {together:.3g} |\n"
    text += worst(rows)
    if slopes := growth(rows):
        text += (
            "\n## Growth\n\nSlope of log time against log size, over the last factor of ten.\n\n"
        )
        text += "| series | gramian | others |\n|---|---|---|\n"
        for series, of in slopes.items():
            others = [f"{name} {slope:.2f}" for name, slope in of.items() if name != OURS]
            text += f"| {series} | {of.get(OURS, float('nan')):.2f} | {'; '.join(others)} |\n"
    if made := shares(rows):
        text += (
            "\n## What a short trial is made of\n\nWhy short trials are further from the limit, "
            "which counts the operations of their samples: a call, what is done once a trial (sums "
            "of the lanes, the matrix, its determinant), and numbers that the caches do not hold. "
            "Where a trial takes less than nothing, 1000 samples already leave the caches.\n"
            "\n| kernel | a call | a trial | a sample | of its limit | 50 samples, 10 000 trials "
            "| beyond the caches |\n|---|---|---|---|---|---|---|\n"
        )
        for one in made:
            beyond = max(one["beyond the caches"], 0.0)
            text += (
                f"| {one['kernel']} | {seconds(one['call'])} | {seconds(one['trial'])} "
                f"| {seconds(one['sample'])} | {percent(one['of the limit'])} "
                f"| {seconds(one['among 10 000'])} | {seconds(beyond)} |\n"
            )
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
    # Another question is not the same work; one answered with fewer digits shows them.
    same = [row for row in ahead if not row.contestant.startswith(("law ", "nothing"))]
    if same:
        text += "\n## Where others are faster\n\n| contest | contestant | x ours | error |\n"
        text += "|---|---|---|---|\n"
        for row in sorted(same, key=lambda row: row.ratio or 0):
            errors = ", ".join(f"{case} {error:.0e}" for case, error in row.errors.items())
            text += f"| {row.contest} | {row.contestant} | {row.ratio:.2f} | {errors} |\n"
        why = {row.contest: row.why for row in rows if row.why}
        for contest in dict.fromkeys(row.contest for row in same if row.contest in why):
            text += f"\n{contest}: {why[contest]}\n"
    if wrong := impossible(rows):
        text += "\n## Errors of the suite\n\nNothing is faster than what binds it: the operations "
        text += (
            "or the rates are wrong.\n\n| contest | contestant | of the limit |\n|---|---|---|\n"
        )
        for row in wrong:
            text += f"| {row.contest} | {row.contestant} | {percent(row.fraction)} |\n"
    missing: dict[str, list[Row]] = {}
    for row in rows:
        if row.message:
            missing.setdefault(row.message.replace("|", "\\|"), []).append(row)
    if missing:
        text += "\n## Not run\n\n| message | contestants | contests |\n|---|---|---|\n"
        for message, of in missing.items():
            who = "; ".join(dict.fromkeys(row.contestant for row in of))
            text += f"| {message} | {who} | {of[0].contest if len(of) == 1 else len(of)} |\n"
    return text


def pictures(rows: Sequence[Row], place: Path) -> list[str]:
    """Draw what the rows are enough for, and return the names of the pictures."""
    place.mkdir(exist_ok=True)
    for name in PICTURES:
        (place / name).unlink(missing_ok=True)  # of another run
    _size(rows, place / "size.png")
    _limit(rows, place / "limit.png")
    _accuracy(rows, place / "accuracy.png")
    return [name for name in PICTURES if (place / name).exists()]


def _figure(width: float, height: float) -> Any:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    return Figure((width, height), dpi=110, layout="constrained")


def _style(contestant: str) -> tuple[str, str, str]:
    return next((style for style in STYLES if style[0] == family(contestant)), ("", "grey", "."))


def _legend(fig: Any, panels: Sequence[Any]) -> None:
    """Name the kinds of contestants that any panel shows, below all of them."""
    seen: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            seen.setdefault(label, handle)
    names = [name for name, *_ in STYLES if name in seen]
    fig.legend(
        [seen[name] for name in names], names, fontsize=8, ncols=max(1, len(names)),
        frameon=False, loc="outside lower center",
    )  # fmt: skip


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
    from matplotlib.ticker import NullFormatter, NullLocator

    whole = {row.size: row.work for row in rows if row.contestant == OURS}
    curves = {
        contestant: sorted(
            ((row.size or 0), (row.minimum or 0) * whole[row.size] * 1e6)
            for row in rows
            if row.contestant == contestant
        )
        for contestant in dict.fromkeys(row.contestant for row in rows)
    }
    dashes: dict[str, int] = {}
    # The legend from above to below, as the curves end.
    for contestant, points in sorted(curves.items(), key=lambda curve: -curve[1][-1][1]):
        if len(points) < 2:
            continue
        kind, color, mark = _style(contestant)
        count = dashes[kind] = dashes.get(kind, -1) + (contestant != OURS)
        axes.loglog(
            *zip(*points, strict=True),
            marker=mark,
            color=color,
            linestyle="-" if contestant == OURS else ("--", ":", "-.")[count % 3],
            linewidth=2.4 if contestant == OURS else 1.2,
            markersize=4.5,
            label=contestant,
        )
    axes.set_title(name, fontsize=9.5, loc="left")
    ticks: list[float] = []
    for size in sorted({row.size or 0 for row in rows}, reverse=True):
        if not ticks or 1.4 * size < ticks[-1]:
            ticks.append(size)
    axes.set_xticks(ticks, [f"{size:,.0f}" for size in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_ylim()
    if high < 20 * low:  # two powers of ten at least, or there is nothing to read off
        axes.set_ylim(10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high)))
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
    limited.sort(key=lambda row: -(row.fraction or 0))
    least = 0.1  # per cent: what is below is drawn there
    fig = _figure(10.0, 1.9 + 0.28 * len(limited))
    axes = fig.subplots()
    for place, row in enumerate(limited):
        others = [
            r
            for r in rows
            if r.contest == row.contest
            and r.fraction
            and r.threads == 1
            and family(r.contestant) not in ("", OURS)
        ]
        for one in (*others, row):
            name, color, mark = _style(one.contestant)
            axes.semilogx(
                max(100 * (one.fraction or 0), least), place, mark, color=color, label=name,
                markersize=8.5 if one is row else 6, markeredgecolor="white", markeredgewidth=0.5,
                clip_on=False, zorder=3,
            )  # fmt: skip
        words = f"{percent(row.fraction)} of {row.limit.split(':')[0]}"
        axes.text(1.02, place, words, va="center", fontsize=8, color=STYLES[0][1],
                  transform=axes.get_yaxis_transform())  # fmt: skip
    axes.set_yticks(range(len(limited)), [row.contest for row in limited], fontsize=7.5)
    axes.set_xlim(least, 100)
    axes.set_xticks([0.1, 1, 10, 100], ["0.1 or less", "1", "10", "100"])
    axes.set_ylim(len(limited) - 0.4, -0.6)
    axes.grid(alpha=0.3, which="major")
    axes.set_xlabel("% of the limit, one thread (right: better)")
    _legend(fig, [axes])
    fig.savefig(path)


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
        axes.set_title(f"the {case}-conditioned case of each contest", fontsize=9.5)
        axes.set_xlabel("time over ours for the same work (right: slower)")
        axes.set_ylim(5e-18, 30)
        axes.grid(alpha=0.25)
    panels[0].set_ylabel("error (below: better)")
    if drawn:
        _legend(fig, panels)
        fig.savefig(path)
