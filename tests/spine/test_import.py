"""The package as it is imported: light, with its public names only, and no file in a circle."""

import ast
import importlib
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

import gramian as gm
from gramian._registry import REGISTRY

SOURCE = Path(gm.__file__).parent
PACKAGES = ["", ".bounds", ".io", ".monte_carlo", ".plot", ".reproduce", ".scenario"]
PACKAGES = [
    "gramian" + name for name in (*PACKAGES, ".models", *(f".models.{m}" for m in REGISTRY))
]


HEAVY = ("matplotlib", "scipy", "pydantic", "typer", "rich", "jinja2", "pandas", "pyarrow")


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        # What takes most of the time of an import: numpy, and classes made by `dataclass`.
        ("import gramian", ("numpy", "dataclasses", "inspect", "pathlib", "json", *HEAVY)),
        ("import gramian; gramian.crlb", HEAVY),
        ("import gramian; gramian.analyze", ("gramian.estimation", "gramian.model", *HEAVY)),
        ("import gramian; gramian.estimate", ("gramian.monte_carlo", *HEAVY)),
        ("import gramian; gramian.dipole.localize", HEAVY),
    ],
)
def test_import_loads_nothing_that_is_not_used(statement, absent):
    code = f"import sys; {statement}; sys.exit(','.join({set(absent)!r} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("first", ["gramian.estimation", "gramian.models.bearings", "gramian.io"])
def test_a_name_is_the_same_whatever_was_imported_first(first):
    code = (
        f"import {first}, gramian as gm; from gramian import *; "
        "assert callable(gm.estimate) and estimate is gm.estimate and load is gm.load"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_an_answer_is_loaded_where_nothing_was_imported_before(tmp_path):
    answer = gm.estimate(gm.from_function(lambda x: x, [1.0, 2.0], 1.0, ["a", "b"]), [1.0, 2.5])
    answer.save(tmp_path / "answer.json")
    code = f"import gramian; print(gramian.load({str(tmp_path / 'answer.json')!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(answer), done.stderr


@pytest.mark.parametrize("name", PACKAGES)
def test_dir_shows_the_public_names_and_the_docstring_has_them(name):
    if name == "gramian.plot":
        pytest.importorskip("matplotlib")
    package = importlib.import_module(name)
    assert dir(package) == sorted(package.__all__)
    for public in dir(package):
        value = getattr(package, public)
        own = getattr(value, "__module__", name).startswith("gramian")
        if name != "gramian.models" and own and public != "__version__":
            assert f"`{public}`" in package.__doc__
    # What it only uses itself is not to be found in it, but for the files it is made of.
    for found, value in vars(package).items():
        if not found.startswith("_") and found not in package.__all__:
            assert isinstance(value, ModuleType), found
            assert value.__name__.startswith(f"{name}."), found


@pytest.mark.parametrize("name", ["gramian", "gramian.monte_carlo"])
def test_what_is_typed_is_what_the_registry_has(name):
    tree = ast.parse(Path(importlib.import_module(name).__file__).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    typed = [alias.asname or alias.name for line in block.body for alias in line.names]
    experiments = [entry.experiment for entry in REGISTRY.values() if entry.experiment]
    wanted = [*gm._MODULES, *gm._HOMES] if name == "gramian" else experiments
    assert sorted(typed) == sorted(wanted)


@pytest.mark.parametrize(
    "file", sorted(SOURCE.rglob("*.py")), ids=lambda file: str(file.relative_to(SOURCE))
)
def test_no_file_imports_the_init_of_its_own_package(file):
    module = ".".join(["gramian", *file.relative_to(SOURCE).with_suffix("").parts])
    parents = {module.rsplit(".", k)[0] for k in range(1, module.count(".") + 1)}
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module in parents:
            for alias in node.names:
                # A module of the package may be had this way, a name of its `__init__` not.
                assert find_spec(f"{node.module}.{alias.name}"), f"line {node.lineno}"
        elif isinstance(node, ast.Import):
            assert not parents & {alias.name for alias in node.names}, f"line {node.lineno}"
