"""The explorer: one page in which a scene is dragged and its verdict seen at once.

- `explore` opens it in a notebook on a scene of your own, and hands the changed scene back.
- `page` is the same page as a file, for `gramian explore` and any browser.
"""

from gramian.explorer._explore import explore
from gramian.explorer._page import page
from gramian.explorer._scenes import Opened, opened

__all__ = ["Opened", "explore", "opened", "page"]


def __dir__() -> list[str]:
    return sorted(__all__)
