# SPDX-License-Identifier: BSD-2-Clause
"""The packages of the harness: which may import which. Imports run downward only, and each kind of
knowledge (XML, FMI, drawing, the command line) has one place.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

import harness
from tests.each import Each

PACKAGE = Path(harness.__file__).parent

LAYERS = (
    ("__init__", "__main__"),
    ("cli",),
    ("api",),
    ("learning",),
    ("authoring", "report"),
    ("studies", "figures", "claims"),
    ("master",),
    ("ssp",),
    ("mission",),
    ("results",),
    ("remote",),
    ("system",),
    ("conformance",),
    ("files",),
    ("errors", "spelling"),
)
"""From the top down; packages of one layer do not know each other."""

FLOOR = {package: len(LAYERS) - i for i, layer in enumerate(LAYERS) for package in layer}

ONLY = {
    "lxml": {"ssp", "remote", "conformance", "files", "authoring"},
    "ctypes": {"master"},
    "gymnasium": {"learning"},
    "fmpy": {"master", "ssp", "remote", "system", "studies", "conformance"},
    "matplotlib": {"figures"},
    "typer": {"cli"},
    "jinja2": {"report"},
    "plotly": {"report"},
    "k3d": {"report"},
    "rich": {"cli", "master"},
    "netCDF4": {"results"},
    "xarray": {"studies", "results"},
    "pandas": {"results"},
    "zarr": {"studies"},
}
"""Libraries, and the only packages that may import them."""


def package_of(file):
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def imports_of(file):
    """Modules that a file imports, wherever in it, those for type checking only included."""
    return tuple(_imports_of(file))


def _imports_of(file):
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from (a.value for a in node.args[:1] if isinstance(a, ast.Constant))


FILES = sorted(PACKAGE.rglob("*.py"))


def ident(file):
    return file.relative_to(PACKAGE).as_posix()


@pytest.fixture
def file():
    return Each(FILES, ident)


def test_imports_run_downward(file):
    package = package_of(file)
    assert package in FLOOR, f"{package} has no place in LAYERS"
    for module in imports_of(file):
        if module.startswith("harness.") and package != "__init__":
            other = module.split(".")[1]
            if other in FLOOR and other != package:
                assert FLOOR[other] < FLOOR[package], f"{ident(file)} imports {module}"


def test_libraries_stay_in_their_packages(file):
    for module in imports_of(file):
        library = module.partition(".")[0]
        if library in ONLY:
            assert package_of(file) in ONLY[library], f"{ident(file)} imports {module}"


def test_the_plain_data_of_a_system_know_fmpy_only_as_the_reader_of_a_description():
    readers = {
        ident(f)
        for f in FILES
        if package_of(f) == "system" and any(m.startswith("fmpy") for m in imports_of(f))
    }
    assert readers == {"system/interface.py"}


def test_no_import_cycle_inside_a_package():
    """Modules of one package import each other in one direction."""
    edges = {
        ident(f): {m for m in imports_of(f) if m.startswith(f"harness.{package_of(f)}.")}
        for f in FILES
    }
    modules = {f"harness.{name.removesuffix('.py').replace('/', '.')}": name for name in edges}
    graph = {
        name: {modules[m] for m in found if m in modules and modules[m] != name}
        for name, found in edges.items()
    }
    finished: set[str] = set()

    def visit(name, above):
        assert name not in above, " imports ".join((*above, name))
        if name not in finished:
            for other in graph[name]:
                visit(other, (*above, name))
            finished.add(name)

    for name in graph:
        visit(name, ())
