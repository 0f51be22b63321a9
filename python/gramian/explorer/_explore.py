"""The explorer in a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from gramian.exceptions import GramianError
from gramian.explorer._scenes import opened

if TYPE_CHECKING:
    from gramian.explorer._widget import Explorer

__all__ = ["explore"]


def explore(
    scene: Any = None,
    state: ArrayLike | Mapping[str, float] | None = None,
    *,
    path: ArrayLike | None = None,
    times: ArrayLike | None = None,
    bearings: ArrayLike | None = None,
    sigma: float | None = None,
    height: int = 900,
) -> Explorer:
    """Open the explorer in a notebook, on a scene of your own.

    Parameters
    ----------
    scene : path, mapping, Scenario, Scene, tracks.Estimate or Problem, optional
        A scenario, as a file or as what such a file says; a `gramian.tracks.Scene` with a
        `state`; an estimate of tracks, with its bearings; or a problem that
        `gramian.tracks.problem`, `gramian.dipole.problem` or `gramian.registration.problem`
        made.
    state : array_like, shape (n,), or mapping, optional
        With a `gramian.tracks.Scene`: where it is asked about.
    path : array_like, shape (m, 2), optional
        In place of a scene, with the three that follow: where the observer was at each
        bearing, m.
    times : array_like, shape (m,), optional
        Of the bearings, increasing, s.
    bearings : array_like, shape (m,), optional
        As measured, clockwise from north, rad.
    sigma : float, optional
        Their standard deviation, rad.
    height : int
        Of the page in the notebook, pixels.

    Returns
    -------
    Explorer
        A widget. Its `scenario` is the scene as it was changed, a mapping that `explore` and
        a scenario file take; `toml` the same as text, `problem` for `gramian.analyze`.

    Raises
    ------
    InputError
        What is none of these; a scene that the page has no picture of: its three kinds are
        one observer and a target at constant velocity, the pass of a dipole before one or two
        sensors, and two radars in the plane.
    GramianError
        Where anywidget is missing: ``pip install 'gramian[notebook]'``.

    Notes
    -----
    The numbers are computed in the browser by the same Rust crate, compiled to WebAssembly.
    Without a notebook the command ``gramian explore FILE.toml`` opens the same page.

    Examples
    --------
    >>> import gramian as gm
    >>> scene = {"model": "dipole", "pass": {"r0": [-10, 6, 2], "v": [1, 0, 0],
    ...          "m": [10, 20, 10], "duration": 20, "step": 0.5, "sigma_nT": 1}}
    >>> explorer = gm.explore(scene)  # doctest: +SKIP
    >>> gm.analyze(explorer.problem).status  # doctest: +SKIP
    'unobservable'
    """
    found = opened(scene, state, path=path, times=times, bearings=bearings, sigma=sigma)
    try:
        from gramian.explorer._widget import Explorer
    except ImportError as error:
        raise GramianError(
            "gm.explore needs anywidget: pip install 'gramian[notebook]'; without a notebook "
            "`gramian explore FILE.toml` opens the same page in a browser"
        ) from error
    return Explorer(found, height)
