"""The widget: the explorer's page in a frame, and the scene that it sends back."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import anywidget
import traitlets

from gramian.exceptions import GramianError
from gramian.explorer._page import page
from gramian.explorer._scenes import Opened, opened
from gramian.problem import Problem
from gramian.scenario import from_values

__all__ = ["Explorer"]


class Explorer(anywidget.AnyWidget):
    """The explorer in a notebook; made by `gramian.explore`.

    Attributes
    ----------
    now : dict
        What the page said last: ``tab``, ``scene``, ``toml``, ``status``; empty until it was
        shown. Observe it to follow the changes: ``explorer.observe(print, "now")``.
    """

    _esm = Path(__file__).with_name("widget.js")
    _page = traitlets.Unicode().tag(sync=True)
    _height = traitlets.Int(900).tag(sync=True)
    _opened = traitlets.Dict().tag(sync=True)
    now = traitlets.Dict().tag(sync=True)

    def __init__(self, scene: Opened, height: int = 900) -> None:
        first = {"tab": scene.tab, "scene": scene.scene, "turn": 0}
        super().__init__(_page=page(), _height=height, _opened=first)

    def show(self, scene: Any, **options: Any) -> None:
        """Show another scene, given as to `gramian.explore`."""
        found = opened(scene, **options)
        turn = self._opened["turn"] + 1
        self._opened = {"tab": found.tab, "scene": found.scene, "turn": turn}

    @property
    def scene(self) -> Opened:
        """The scene as the page has it now; `gramian.explore` takes it."""
        said = self.now or self._opened
        return Opened(said["tab"], said["scene"])

    @property
    def toml(self) -> str:
        """The scene as it is now, as a scenario file."""
        if "toml" not in self.now:
            raise GramianError("the explorer has not been shown yet: display it first")
        return str(self.now["toml"])

    @property
    def scenario(self) -> dict[str, Any]:
        """The scene as it is now, as a mapping: what a scenario file says."""
        return tomllib.loads(self.toml)

    @property
    def problem(self) -> Problem:
        """The scene as it is now, for `gramian.analyze`."""
        return from_values(self.scenario).problem
