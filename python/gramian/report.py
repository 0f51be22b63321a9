"""What a command answers: one `Report`, shown in a terminal, as a page and as JSON."""

from __future__ import annotations

import base64
import io
import json
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gramian._answers import Tone
from gramian._core import __version__
from gramian._files import digest, write_whole
from gramian._layout import columns, facts, paragraph
from gramian._text import number, visible
from gramian.exceptions import GramianError, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from gramian.analysis import Observability

__all__ = [
    "Picture",
    "Report",
    "Table",
    "Tone",
    "answer_pictures",
    "answer_tables",
    "page_unit",
    "tone_of",
]

_STYLES = {"good": "bold green", "weak": "bold dark_orange3", "bad": "bold red"}


@dataclass(frozen=True)
class Table:
    """A table of text cells.

    Attributes
    ----------
    title : str
    columns : sequence of str
    rows : sequence of sequence of str
        As many cells in each as there are columns.
    note : str
        A line below it.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def is_text(self, column: int) -> bool:
        """Say whether a column is read from the left: names and phrases, not numbers."""
        words = (re.findall(r"\b[A-Za-z_]{3,}", row[column]) for row in self.rows)
        return column == 0 or any(len(w) > 1 and w != ["not", "observable"] for w in words)


@dataclass(frozen=True)
class Picture:
    """A picture, drawn only when a page is written.

    Attributes
    ----------
    title : str
    caption : str
        What to see in it, in a sentence or two.
    draw : callable
        Returns a matplotlib `Figure`.
    """

    title: str
    caption: str
    draw: Callable[[], Figure]


@dataclass(frozen=True)
class Report:
    """The answer of a command, the verdict first.

    Attributes
    ----------
    title : str
    subtitle : str
    tone : {"good", "weak", "bad"}
    headline : str
        The verdict in a word or two, capitals: "WEAKLY OBSERVABLE".
    verdict : str
        The verdict in a sentence.
    facts : sequence of (str, str)
        Short labelled lines below it: ("what would help most", "...").
    tables : sequence of Table
    pictures : sequence of Picture
    data : mapping
        What result.json holds: plain lists, numbers and strings.
    inputs : sequence of Path
        The files it answers for; page and data carry their digests.
    """

    title: str
    subtitle: str
    tone: Tone
    headline: str
    verdict: str
    facts: Sequence[tuple[str, str]] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    inputs: Sequence[Path] = ()

    def show(self, console: Console) -> None:
        """Print the report to a terminal, without its pictures."""
        from rich.text import Text

        width = console.width

        def say(*parts: tuple[str, str]) -> None:
            # Names come from files: their control characters are shown, not obeyed.
            console.print(Text.assemble(*((visible(t), s) for t, s in parts)), soft_wrap=True)

        for k, line in enumerate(paragraph(f"{self.title}   {self.subtitle}", width)):
            head = self.title if k == 0 and line.startswith(self.title) else ""
            say((head, "bold"), (line[len(head) :], ""))
        say(("", ""))
        for k, line in enumerate(paragraph(f"{self.headline}: {self.verdict}", width)):
            head = self.headline if k == 0 and line.startswith(self.headline) else ""
            say((head, _STYLES[self.tone]), (line[len(head) :], ""))
        for label, text in facts(self.facts, width):
            say(("  " + label, "dim"), ("  " + text if text else "", ""))
        for table in self.tables:
            say(("", ""))
            say((table.title, "bold"))
            words = [table.is_text(i) for i in range(len(table.columns))]
            for k, (top, body) in enumerate(columns(table.columns, table.rows, words, width - 1)):
                if k:
                    say(("", ""))
                for line in top:
                    say((" " + line, "dim"))
                for line in body:
                    say((" " + line, ""))
            if table.note:
                for line in paragraph(table.note, width, " "):
                    say((line, "italic"))

    def to_json(self) -> str:
        """Return the data as JSON text."""
        head = {
            "title": self.title,
            "subtitle": self.subtitle,
            "headline": self.headline,
            "verdict": self.verdict,
            "facts": dict(self.facts),
        }
        everything = head | dict(self.data) | {"origin": self._origin}
        return json.dumps(everything, indent=2, allow_nan=False) + "\n"

    @cached_property
    def _origin(self) -> dict[str, Any]:
        """The version that answered, when, and for which files.

        The date is that of SOURCE_DATE_EPOCH where it is set, so that a page can be
        made again to the byte.
        """
        given = os.environ.get("SOURCE_DATE_EPOCH", "")
        try:
            made = datetime.fromtimestamp(int(given) if given else time.time(), UTC)
        except (ValueError, OverflowError, OSError) as error:
            raise InputError(
                f"SOURCE_DATE_EPOCH = {given!r}: must be seconds since 1970, a whole number"
            ) from error
        return {
            "version": __version__,
            "date": f"{made:%Y-%m-%d %H:%M:%S} UTC",
            "inputs": [{"name": path.name, "sha256": digest(path)} for path in self.inputs],
        }

    def write(self, out: Path) -> tuple[Path, Path]:
        """Write report.html and result.json into a folder, made if need be.

        Returns
        -------
        tuple of Path
            The page and the data.

        Raises
        ------
        GramianError
            When the folder cannot be written or jinja2 is not installed.
        """
        page, data = out / "report.html", out / "result.json"
        text = self._page()
        try:
            out.mkdir(parents=True, exist_ok=True)
            write_whole(page, text.encode())
            write_whole(data, self.to_json().encode())
        except OSError as error:
            raise GramianError(f"cannot write the report to {out}: {error}") from error
        return page, data

    def write_data(self, out: Path) -> Path:
        """Write result.json alone into a folder, made if need be; it takes no other package."""
        data = out / "result.json"
        try:
            out.mkdir(parents=True, exist_ok=True)
            write_whole(data, self.to_json().encode())
        except OSError as error:
            raise GramianError(f"cannot write the report to {out}: {error}") from error
        return data

    def _page(self) -> str:
        try:
            import jinja2
        except ImportError as error:  # pragma: no cover - without the extra
            raise GramianError("a report needs jinja2: pip install 'gramian[report]'") from error
        environment = jinja2.Environment(
            loader=jinja2.PackageLoader("gramian"),
            autoescape=True,
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        # Letters that can be read where a picture is as wide as a telephone.
        with _large_letters() if self.pictures else nullcontext():
            pictures = [
                {"title": p.title, "caption": p.caption} | _embedded(p.draw())
                for p in self.pictures
            ]
        return environment.get_template("report.html").render(
            report=self, pictures=pictures, origin=self._origin
        )


def page_unit(unit: str) -> tuple[float, str]:
    """Return by what to multiply for a page, and the unit there: angles are in degrees."""
    angle = re.fullmatch(r"rad(/s|/s\^2)?", unit)
    return (180 / np.pi, f"deg{angle[1] or ''}") if angle else (1.0, unit)


def answer_tables(answer: Observability, *, suggestions: int = 6) -> list[Table]:
    """Return the tables that every model's answer has: bounds, null space, knowledge."""
    priors = answer.problem.priors
    scale = answer.problem.scale
    rows = []
    factors, units = zip(*(page_unit(unit) for unit in answer.units), strict=True)
    for i, (name, unit, f) in enumerate(zip(answer.names, units, factors, strict=True)):
        cells = [name, number(f * answer.crlb_std[i]), unit]
        if priors:
            prior = number(f * priors[name]) if name in priors else ""
            cells += [number(f * answer.data_std[i]), prior]
        if not np.isnan(scale).all():
            cells.append("" if np.isnan(scale[i]) else number(f * scale[i]))
        rows.append(cells)
    columns = ["state", "standard deviation", "unit"]
    if priors:
        columns += ["from the measurements alone", "prior"]
    if not np.isnan(scale).all():
        columns.append("weak above")
    tables = [Table("How accurately, at best", columns, rows)]
    if answer.nullity:
        tables.append(
            Table(
                "What cannot be determined",
                ["unobservable combination"],
                [[text] for text in answer.null_combinations],
                "Moving the states together in these proportions changes no measurement."
                + (" Angles in radians here." if "rad" in " ".join(answer.units) else ""),
            )
        )
    groups = [group for group in answer.islands if len(group) < len(answer.names)]
    if groups:
        tables.append(
            Table(
                "States that no measurement ties to each other",
                ["group", "states"],
                [[str(k), ", ".join(group)] for k, group in enumerate(groups, 1)],
            )
        )
    if answer.status in {"observable", "weak"} and len(answer.problem.rows) > answer.rank:
        tables += _critical_table(answer)
    if answer.suggestions:
        then = [
            f"{n} then, {u}" if u else f"{n} then" for n, u in zip(answer.names, units, strict=True)
        ]
        columns = ["known exactly", "left unobservable", *then]
        tables.append(
            Table(
                "What one piece of knowledge would give",
                columns,
                [
                    [
                        s.name,
                        str(s.nullity) if s.nullity else "nothing",
                        *map(number, np.array(factors) * s.crlb_std),
                    ]
                    for s in answer.suggestions[:suggestions]
                ],
            )
        )
    return tables


def _critical_table(answer: Observability, count: int = 6) -> list[Table]:
    found = answer.critical()
    if not found:
        return []
    lost = [
        f"{one.nullity} combination{'s' if one.nullity > 1 else ''} not determined"
        if one.nullity
        else f"{one.worst} {number(one.growth)} times as uncertain"
        for one in found[:count]
    ]
    more = f"The first {count} of {len(found)}." if len(found) > count else ""
    rows = [[one.name, text] for one, text in zip(found, lost, strict=False)]
    return [Table("Measurements that must not be lost", ["measurement", "without it"], rows, more)]


def answer_pictures(answer: Observability) -> list[Picture]:
    """Return the pictures that every model's answer has."""
    caption = (
        "Bars in red are zero to rounding: as many combinations of the states are not determined."
        if answer.nullity
        else "No bar is zero to rounding: every combination of the states is determined."
    )
    return [Picture("Singular values", caption, answer.plot)]


def tone_of(answer: Observability) -> Tone:
    """Return the colour of an answer's status."""
    return answer.tone


@contextmanager
def _large_letters() -> Iterator[None]:
    """Draw with larger letters."""
    import matplotlib as mpl

    with mpl.rc_context({"font.size": 12.5}):
        yield


def _embedded(figure: Figure) -> dict[str, Any]:
    """Return a figure as a data URI, and whether it is legible on a small screen."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    kind = "svg+xml"
    if len(text) > 1_000_000:
        # Many points: as pixels it is smaller and quicker to show.
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=160)
        text, kind = buffer.getvalue(), "png"
    source = f"data:image/{kind};base64,{base64.b64encode(text).decode('ascii')}"
    return {"source": source, "narrow": figure.get_figwidth() < 7}
