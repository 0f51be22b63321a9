"""The papers: each published figure beside the computed one.

`reproduce` computes one of the `PAPERS`.
"""

from gramian.reproduce._papers import PAPERS, reproduce

__all__ = ["PAPERS", "reproduce"]


def __dir__() -> list[str]:
    return sorted(__all__)
