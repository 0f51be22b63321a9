"""What a paper claims, each beside what is computed: comparisons that can fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gramian._text import number
from gramian.report import Table, Tone

__all__ = [
    "Claim",
    "Outcome",
    "claims_data",
    "claims_table",
    "fitted",
    "near",
    "refuted",
    "rounded",
    "true",
    "verdict",
]

#: `holds`: as the paper says. `misprint` and `refuted`: the paper is wrong, and what is right
#: was computed and agrees. `fitted`: taken from the print, so not counted. `FAILS`: neither.
Outcome = Literal["holds", "misprint", "refuted", "fitted", "FAILS"]


@dataclass(frozen=True)
class Claim:
    """A claim and its comparison.

    Attributes
    ----------
    what : str
        What the paper states, with the number it has there.
    printed, computed : str
    outcome : {"holds", "misprint", "refuted", "fitted", "FAILS"}
    note : str
        What is wrong with the print, or where it was fitted.
    """

    what: str
    printed: str
    computed: str
    outcome: Outcome
    note: str = ""


def near(
    what: str,
    printed: float,
    computed: float,
    *,
    rel: float = 1e-9,
    floor: float = 0.0,
    right: float | None = None,
    note: str = "",
) -> Claim:
    """Compare numbers, to `rel` of the printed one or `floor`.

    With `right`, what the paper should have: a print that differs from it, where the
    computed number equals it, is a misprint.
    """

    def same(wanted: float) -> bool:
        return abs(computed - wanted) <= max(rel * abs(wanted), floor)

    outcome: Outcome
    if right is None:
        outcome = "holds" if same(printed) else "FAILS"
    else:
        outcome = "misprint" if same(right) and not same(printed) else "FAILS"
    shown = note if outcome != "holds" else ""
    return Claim(what, number(printed), number(computed), outcome, shown)


def rounded(
    what: str,
    printed: str,
    computed: float,
    shape: str,
    *,
    right: str | None = None,
    note: str = "",
) -> Claim:
    """Compare a printed figure with a computed one in the digits printed.

    `shape` is the format of the print (".4f"); `right` the figure that should stand there.
    """
    digits = format(computed, shape)
    outcome: Outcome = "FAILS"
    if digits == printed and right is None:
        outcome = "holds"
    elif right is not None and digits == right != printed:
        outcome = "misprint"
    shown = note if outcome == "misprint" else ""
    return Claim(what, printed, number(computed), outcome, shown)


def true(what: str, holds: bool, found: str, note: str = "") -> Claim:
    """State that something holds; `found` is what was computed."""
    return Claim(what, "holds", found, "holds" if holds else "FAILS", note)


def refuted(what: str, counterexample: bool, found: str, note: str) -> Claim:
    """State that a claim of the paper is wrong, by a counterexample that is computed."""
    return Claim(what, "holds", found, "refuted" if counterexample else "FAILS", note)


def fitted(what: str, printed: str, computed: str, note: str) -> Claim:
    """Show a number that was chosen to fit the print: it proves nothing and is not counted."""
    return Claim(what, printed, computed, "fitted", note)


def verdict(claims: Sequence[Claim]) -> tuple[Tone, str, str]:
    """Return tone, headline and sentence of all claims together."""
    counts = {
        outcome: sum(claim.outcome == outcome for claim in claims)
        for outcome in ("holds", "misprint", "refuted", "fitted", "FAILS")
    }
    counted = len(claims) - counts["fitted"]
    failing = [claim.what for claim in claims if claim.outcome == "FAILS"]
    if failing:
        more = f" and {len(failing) - 3} more" if len(failing) > 3 else ""
        sentence = f"{len(failing)} of {counted} comparisons fail: {'; '.join(failing[:3])}{more}"
        return "bad", "NOT REPRODUCED", sentence
    parts = [f"{counts['holds']} of {counted} comparisons hold"]
    if counts["misprint"]:
        some = "is a misprint" if counts["misprint"] == 1 else "are misprints"
        parts.append(f"{counts['misprint']} {some}, named below")
    if counts["refuted"]:
        some = "claim is" if counts["refuted"] == 1 else "claims are"
        parts.append(f"{counts['refuted']} {some} refuted by a counterexample")
    if counts["fitted"]:
        parts.append(f"{counts['fitted']} fitted to the print, not counted")
    tone: Tone = "weak" if counts["refuted"] else "good"
    headline = "REPRODUCED, WITH COUNTEREXAMPLES" if counts["refuted"] else "REPRODUCED"
    return tone, headline, "; ".join(parts)


def claims_table(title: str, claims: Sequence[Claim], note: str = "") -> Table:
    """Return the claims as a table."""
    return Table(
        title,
        ["claim", "printed", "computed", "outcome", "note"],
        [[c.what, c.printed, c.computed, c.outcome, c.note] for c in claims],
        note,
    )


def claims_data(claims: Sequence[Claim]) -> list[dict[str, Any]]:
    """Return the claims as plain data."""
    return [
        {
            "claim": c.what,
            "printed": c.printed,
            "computed": c.computed,
            "outcome": c.outcome,
            "note": c.note,
        }
        for c in claims
    ]
