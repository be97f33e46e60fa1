# SPDX-License-Identifier: BSD-2-Clause
"""Small third-party FMUs, and systems made of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from harness.files import paths
from harness.system.model import Component, Connection, Experiment, Parameter, Port, System
from tests.harness.third_party_fmu import MODELS, build
from tests.shared import shared
from tests.sketches import sketched


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache for the tests alone, one for all workers."""
    folder = shared(tmp_path_factory, "cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HARNESS_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="session")
def fmu_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with all third-party FMUs."""
    folder = tmp_path_factory.mktemp("fmus")
    for model in MODELS:
        build(model, folder)
    return folder


@pytest.fixture(scope="session")
def fmus(fmu_folder: Path) -> dict[str, Path]:
    """Paths of the third-party FMUs by name."""
    return {path.stem: path for path in fmu_folder.glob("*.fmu")}


@pytest.fixture
def project_fmus(fmus: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Make the small FMUs count as FMUs of the project, for one test alone."""
    monkeypatch.setattr(paths, "fmus", lambda: fmus)
    paths._is_ours.cache_clear()
    yield
    paths._is_ours.cache_clear()


@pytest.fixture
def make(fmus: dict[str, Path]) -> Callable[..., System]:
    """Systems from few words: components name -> FMU, connections "a.y > b.u", parameters "a.k" ->
    value.
    """

    def make_system(
        components: Mapping[str, str],
        connections: Iterable[str] = (),
        parameters: Mapping[str, Any] | None = None,
        timing: Mapping[str, tuple[int, int]] | None = None,
        **experiment: Any,
    ) -> System:
        values: dict[str, dict[str, Parameter]] = {name: {} for name in components}
        for name, value in (parameters or {}).items():
            component, _, variable = name.partition(".")
            values[component][variable] = Parameter(value)
        timing = timing or {}
        parts = tuple(
            Component(n, fmus[f], values[n], *timing.get(n, ())) for n, f in components.items()
        )
        wires = tuple(Connection(*map(_port, text.split(" > "))) for text in connections)
        given = {"start": 0.0, "stop": 6.0, "step": 1.0, "algorithm": "gauss-seidel"} | experiment
        return System("test", parts, wires, Experiment(**given))

    return make_system


def _port(name: str) -> Port:
    component, _, variable = name.partition(".")
    return Port(component, variable)


@pytest.fixture(scope="module", autouse=True)
def _sketches() -> Iterator[None]:
    """The look of pictures is tested elsewhere."""
    with sketched():
        yield


@pytest.fixture
def trusted(monkeypatch, tmp_path):
    """Runs of these small FMUs in this process, in a folder of their own: a child for each of them
    costs more than all else where it is not what a test is about.
    """
    monkeypatch.setattr("harness.master.isolated.all_ours", lambda _: True)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """FMUs of the tests write files where they run: never into the checkout."""
    monkeypatch.chdir(tmp_path)
