import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).parent

# A shell that runs the tests in the background has them ignore Ctrl-C, and so
# would the processes in which they try it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def recorded() -> Callable[[str], Path]:
    """Give the path of a recorded file, or skip: fail where it is required."""
    folder = Path(os.environ.get("GRAMIAN_DATA", HERE.parent.parent / "shared" / "data"))

    def find(name: str) -> Path:
        path = folder / name
        if path.exists():
            return path
        reason = f"the recorded file {name} is not in {folder} (GRAMIAN_DATA names another folder)"
        if os.environ.get("GRAMIAN_REQUIRE_RECORDED") == "1":
            pytest.fail(reason)
        pytest.skip(reason)

    return find
