# SPDX-License-Identifier: BSD-2-Clause
"""Systems in Maestro of the INTO-CPS Association, which Maven fetches: FMUs, connections and
parameters as a multi-model, fixed steps.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from harness import load
from harness.files import paths
from tests.interop.jacobi import jacobi

VERSION = "3.1.1"
STEPS = 20
SYSTEMS = ("ppc_tracking_filtered", "relay_approach", "space_robot", "sync_approach")
"""Maestro takes minutes of processor time to prepare larger systems."""

POM = """<project xmlns="http://maven.apache.org/POM/4.0.0">
  <modelVersion>4.0.0</modelVersion>
  <groupId>local</groupId><artifactId>maestro</artifactId><version>1</version>
  <packaging>pom</packaging>
  <dependencies>{}</dependencies>
</project>
"""
PARTS = (("commons-io", "commons-io", "2.15.1"), ("org.into-cps.maestro", "maestro", VERSION))
"""Maestro alone brings a commons-io that its own parts cannot use; the first entry wins."""

pytestmark = [pytest.mark.interop, pytest.mark.tool("Maestro", VERSION)]


@pytest.fixture(scope="module")
def class_path(tmp_path_factory):
    """Return the class path of Maestro, downloaded once."""
    for tool in ("java", "mvn"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed: Maestro was not run")
    folder = tmp_path_factory.mktemp("maestro")
    names = ("groupId", "artifactId", "version")
    parts = "".join(
        f"<dependency>{''.join(f'<{n}>{x}</{n}>' for n, x in zip(names, part, strict=True))}"
        "</dependency>"
        for part in PARTS
    )
    (folder / "pom.xml").write_text(POM.format(parts), encoding="utf-8")
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    command = [
        "mvn", "-q", "-B", f"-Dmaven.repo.local={base / 'servicing-fmus' / 'maven'}",
        "dependency:build-classpath", "-Dmdep.outputFile=path.txt",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"Maestro cannot be had from Maven Central: {done.stdout[-200:]}")
    return (folder / "path.txt").read_text(encoding="utf-8")


def multi_model(name):
    """Return a system in the notation of Maestro, `{fmu}.instance.variable`."""
    with load(name) as system:
        key = {c.name: f"{{{c.fmu.stem}}}.{c.name}" for c in system.components}
        connections = {}
        for c in system.connections:
            ends = (f"{key[port.component]}.{port.variable}" for port in (c.source, c.target))
            connections.setdefault(next(ends), []).append(next(ends))
        return {
            "fmus": {f"{{{c.fmu.stem}}}": str(paths.fmus()[c.fmu.stem]) for c in system.components},
            "connections": connections,
            "parameters": {
                f"{key[c.name]}.{n}": float(p.value)
                for c in system.components
                for n, p in c.parameters.items()
            },
            "startTime": system.experiment.start,
            "endTime": system.experiment.start + STEPS * system.experiment.step,
            "algorithm": {"type": "fixed-step", "size": system.experiment.step},
        }


@pytest.mark.parametrize("name", SYSTEMS)
def test_maestro_gives_our_bits(class_path, name, tmp_path):
    """It records the connected outputs."""
    (tmp_path / "mm.json").write_text(json.dumps(multi_model(name)), encoding="utf-8")
    program = ["java", "-cp", class_path, "org.intocps.maestro.Main"]
    command = [*program, "import", "sg1", "mm.json", "--interpret", "-output", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    with (tmp_path / "out" / "outputs.csv").open(encoding="utf-8", newline="") as text:
        head, *rows = csv.reader(text)
    values = np.array(rows, dtype=float)
    result = jacobi(name, STEPS)
    assert len(values) >= STEPS
    np.testing.assert_allclose(values[:, 0], result.time[: len(values)], rtol=0, atol=1e-9)
    names = [column.partition("}.")[2] for column in head[1:]]
    assert len(names) >= 7
    for k, column in enumerate(names, 1):
        assert np.array_equal(values[:, k], result[column][: len(values)]), column
