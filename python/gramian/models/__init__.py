"""The models: each makes rows, and brings what is special to it.

A new model is one folder here and one line in `gramian._registry`.
"""

from types import ModuleType as _ModuleType

from gramian._registry import REGISTRY as _REGISTRY
from gramian._registry import load as _load

__all__ = list(_REGISTRY)


def __getattr__(name: str) -> _ModuleType:
    if name in _REGISTRY:
        return _load(f"models.{name}")
    raise AttributeError(f"module 'gramian.models' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
