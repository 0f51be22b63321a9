"""The papers that can be reproduced."""

from __future__ import annotations

from importlib import import_module

from gramian.exceptions import InputError
from gramian.report import Report

__all__ = ["PAPERS", "reproduce"]

#: The papers that can be reproduced, and the module of each: its `run()` returns a `Report`.
PAPERS: dict[str, str] = {
    "dai-2020": "gramian.reproduce.dai_2020",
    "li-sheng-2009": "gramian.reproduce.li_sheng_2009",
    "yang-yin-2012": "gramian.reproduce.yang_yin_2012",
    "zhu-2013": "gramian.reproduce.zhu_2013",
    "xu-2009": "gramian.reproduce.xu_2009",
}


def reproduce(name: str) -> Report:
    """Compute the figures of a paper and compare them with the printed values.

    Parameters
    ----------
    name : str
        A key of `PAPERS`.

    Raises
    ------
    InputError
        For any other name.
    """
    if name not in PAPERS:
        raise InputError(f"no paper is named {name!r}: there are {', '.join(PAPERS)}")
    report: Report = import_module(PAPERS[name]).run()
    return report
