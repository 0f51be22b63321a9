"""The page of the explorer, with a scene in it."""

from __future__ import annotations

import json
from importlib.resources import files

from gramian.exceptions import GramianError
from gramian.explorer._scenes import Opened

__all__ = ["page"]

_MARK = "/*SCENE*/"


def page(scene: Opened | None = None) -> str:
    """Return the explorer's page, as HTML that needs nothing beside it.

    Parameters
    ----------
    scene : Opened, optional
        What it opens on; by default its own first example.

    Raises
    ------
    GramianError
        Where the installation has no page: it was built without the Rust target for
        WebAssembly.

    Examples
    --------
    >>> from gramian.explorer import opened, page
    >>> text = page(opened(path=[[0, 0], [900, 0], [900, 900]], times=[0, 300, 600],
    ...                    bearings=[0.6, 0.3, 0.2], sigma=0.01))  # doctest: +SKIP
    """
    file = files("gramian.explorer") / "page.html"
    if not file.is_file():
        raise GramianError(
            "this installation has no page of the explorer: wheels of a release have it; in a "
            "checkout `make explorer` builds it"
        )
    text = file.read_text(encoding="utf-8")
    if scene is None:
        return text
    given = json.dumps({"tab": scene.tab, "scene": scene.scene}).replace("<", "\\u003c")
    return text.replace(f">{_MARK}<", f">{given}<")
