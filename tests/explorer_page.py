"""What the tests of the explorer share: its build, and when its page has come to rest."""

import importlib.util
import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def load_build():
    spec = importlib.util.spec_from_file_location("explorer_build", ROOT / "explorer/build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def absent(reason):
    if os.environ.get("GRAMIAN_REQUIRE_EXPLORER") == "1":
        pytest.fail(reason)
    pytest.skip(reason)


def chromium():
    """Return the path of the system's Chromium, or None."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def settle(page):
    page.wait_for_function("window.explorer && explorer.ready && explorer.calm")
