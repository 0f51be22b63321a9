"""From nothing to an answer: imports and the command, each in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from harness import OURS, Contest, Contestant, main

EASY = str(Path(__file__).parents[1] / "python" / "gramian" / "demo" / "1_easy.toml")


def python(*arguments: str) -> Callable[[Any], Callable[[], Any]]:
    """A process that ends well."""

    def prepare(_: Any) -> Callable[[], Any]:
        command = [sys.executable, *arguments]
        return lambda: subprocess.run(command, check=True, capture_output=True)

    return prepare


def contest(name: str, ours: list[str], others: dict[str, str]) -> Contest:
    """A process of ours, beside imports of others."""
    return Contest(
        name,
        "process",
        1.0,
        None,
        [
            Contestant(OURS, python(*ours)),
            *(Contestant(of, python("-c", code)) for of, code in others.items()),
        ],
        note="The start of the interpreter is in every row; ours imports numpy.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    numpy = {"nothing: import numpy": "import numpy"}
    peers = {"import SciPy, its optimisers": "import scipy.optimize"}
    if not quick:
        peers |= {
            "import python-control": "import control",
            "import Stone Soup, a state": "import stonesoup.types.state",
            "import JAX": "import jax.numpy",
        }
    yield contest("import", ["-c", "import gramian"], numpy | peers)
    yield contest("gramian analyze of a scenario", ["-m", "gramian", "analyze", EASY], numpy)


if __name__ == "__main__":
    main(contests)
