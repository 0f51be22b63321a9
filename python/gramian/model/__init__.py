"""A model of the user's own: a measurement function, what is known of it, and its rows.

| | |
|---|---|
| `from_function` | makes a model of a measurement function |
| `Model` | its rows, noise and simulated measurements at any state |
"""

from gramian.model._from_function import from_function
from gramian.model._model import Model

__all__ = ["Model", "from_function"]
