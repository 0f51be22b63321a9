"""Forked children work; a second interpreter is refused with a sentence, not with a crash."""

import subprocess
import sys

import pytest

FORK = """
import os
import numpy as np
import gramian as gm

rows = np.random.default_rng(0).normal(size=(2000, 20, 4))
before = gm.gram(rows)  # the parent's threads run
child = os.fork()
if child == 0:
    os._exit(0 if np.array_equal(gm.gram(rows), before) else 1)
print(os.waitpid(child, 0)[1])
"""

SECOND = """
import sys
import _xxsubinterpreters as interpreters
import gramian._core

second = interpreters.create()
script = f"import sys; sys.path[:0] = {sys.path!r}; import gramian._core"
try:
    interpreters.run_string(second, script)
except interpreters.RunFailedError as error:
    print(error)
"""


def said(script):
    run = [sys.executable, "-c", script]
    return subprocess.run(run, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
def test_a_forked_child_has_threads_of_its_own():
    assert said(FORK).strip() == "0"


def test_a_second_interpreter_is_refused():
    pytest.importorskip("_xxsubinterpreters", reason="the module of CPython 3.11 and 3.12")
    assert "subinterpreters are not supported" in said(SECOND)


def test_the_module_loads_again_in_its_own_interpreter():
    script = "import sys, gramian._core; del sys.modules['gramian._core']; import gramian._core"
    assert said(script) == ""
