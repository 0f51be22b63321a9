"""Text in lines of a given width: paragraphs, labelled facts and tables.

A number stays with its unit, nothing is cut in the middle of a word, and a table that is
too wide goes on below itself with its first column repeated.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

__all__ = ["columns", "facts", "paragraph"]

#: Stands for a space at which a line must not end.
_GLUE = "\ue000"

#: A number and what belongs to it, up to a short unit: "2859 m", "+- 0.3 m/s", "5 deg".
_NUMBER = re.compile(r"(?<=\d) (?=(?:%|[a-zA-Z]{1,3}(?:/[a-zA-Z^0-9]+)?|1/[a-z^0-9]+)\b|%)")
_MINUS = re.compile(r"\+- (?=\d)")
#: A state and its change: "x0 +1.2".
_CHANGE = re.compile(r"(?<=\w) (?=[+-]\d)")

#: A column of words is wrapped to no less than this.
_NARROWEST = 16

_BETWEEN = 2


def paragraph(text: str, width: int, indent: str = "", first: str | None = None) -> list[str]:
    """Return text in lines of at most `width`, but for words that are longer."""
    glued = text
    for pattern, by in ((_NUMBER, _GLUE), (_MINUS, f"+-{_GLUE}"), (_CHANGE, _GLUE)):
        glued = pattern.sub(by, glued)
    lines = textwrap.wrap(
        glued,
        max(width, 1),
        initial_indent=indent if first is None else first,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_GLUE, " ") for line in lines] or [""]


def facts(pairs: Sequence[tuple[str, str]], width: int) -> list[tuple[str, str]]:
    """Return labels and texts side by side, as (label, text) of each line."""
    if not pairs:
        return []
    left = min(max(len(label) for label, _ in pairs), width // 2 - 4)
    lines = []
    for label, text in pairs:
        labels = paragraph(label, left)
        texts = paragraph(text, width - left - 4)
        for k in range(max(len(labels), len(texts))):
            one = labels[k] if k < len(labels) else ""
            lines.append((one.ljust(left), texts[k] if k < len(texts) else ""))
    return lines


def columns(
    heads: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[bool], width: int
) -> list[tuple[list[str], list[str]]]:
    """Return a table as blocks that fit, each with the lines of its head and of its rows.

    Parameters
    ----------
    heads : sequence of str
    rows : sequence of sequence of str
    words : sequence of bool
        Which columns are read from the left.
    width : int
    """
    cells = [max((len(row[i]) for row in rows), default=0) for i in range(len(heads))]
    wide = [max(cell, len(head)) for head, cell in zip(heads, cells, strict=True)]

    def shrink(least: Sequence[int]) -> None:
        while sum(wide) + _BETWEEN * len(wide) > width:
            able = [i for i in range(len(wide)) if wide[i] > least[i]]
            if not able:
                return
            wide[max(able, key=lambda i: wide[i] - least[i])] -= 1

    # Heads give way first, then words; only then is the table cut in two.
    broken = [max(cell, _longest([head])) for head, cell in zip(heads, cells, strict=True)]
    shrink(broken)
    shrink(
        [
            max(_NARROWEST, _longest([heads[i], *(row[i] for row in rows)])) if word else broken[i]
            for i, word in enumerate(words)
        ]
    )
    blocks = []
    for chosen in _split(wide, width):
        head = _lines([heads[i] for i in chosen], [wide[i] for i in chosen],
                      [words[i] for i in chosen], bottom=True)  # fmt: skip
        body = [
            line
            for row in rows
            for line in _lines(
                [row[i] for i in chosen], [wide[i] for i in chosen], [words[i] for i in chosen]
            )
        ]
        blocks.append((head, body))
    return blocks


def _longest(texts: Sequence[str]) -> int:
    """Return the length of the longest word."""
    return max((len(word) for text in texts for word in text.split()), default=0)


def _split(wide: Sequence[int], width: int) -> list[list[int]]:
    """Return which columns stand in each block; the first stands in all."""
    blocks: list[list[int]] = []
    current: list[int] = []
    for i, size in enumerate(wide):
        taken = sum(wide[k] + _BETWEEN for k in current)
        if len(current) > 1 and taken + size + _BETWEEN > width:
            blocks.append(current)
            current = [0]
        current.append(i)
    return [*blocks, current]


def _lines(
    texts: Sequence[str], wide: Sequence[int], words: Sequence[bool], *, bottom: bool = False
) -> list[str]:
    """Return the lines of one row; short cells of a head stand at its bottom."""
    parts = [
        paragraph(text, size) if len(text) > size else [text]
        for text, size in zip(texts, wide, strict=True)
    ]
    high = max(len(part) for part in parts)
    lines = []
    for k in range(high):
        cells = []
        for part, size, word in zip(parts, wide, words, strict=True):
            at = k - (high - len(part)) if bottom else k
            text = part[at] if 0 <= at < len(part) else ""
            cells.append(text.ljust(size) if word else text.rjust(size))
        lines.append((" " * _BETWEEN).join(cells).rstrip())
    return lines
