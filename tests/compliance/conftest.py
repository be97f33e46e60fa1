# SPDX-License-Identifier: BSD-2-Clause
"""Every FMU of the build: its file, its parsed description, and the library, loaded once."""

from __future__ import annotations

import json
import select
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path

import pytest

from tests.compliance import description
from tests.compliance.fmus import ROOT, TESTED
from tests.compliance.probe import ENDING, FOLDER, Fmu, Instance
from tests.each import Each


@pytest.fixture(scope="session")
def archive() -> Each:
    return Each(TESTED, lambda path: path.stem)


@pytest.fixture(scope="session")
def about(archive) -> Each:
    return archive.map(cache(description.read))


@pytest.fixture(scope="session")
def fmu(archive, tmp_path_factory) -> Each:
    folder = tmp_path_factory.mktemp("fmus")
    return archive.map(cache(lambda path: Fmu(path, folder / path.stem)))


@pytest.fixture(scope="session")
def symbols(archive, tmp_path_factory) -> Each:
    """Dynamic symbols of the library with their letters, all by one call of nm."""
    if (nm := shutil.which("nm")) is None:
        pytest.skip("nm (binutils) is not installed")
    folder = tmp_path_factory.mktemp("libraries")
    for path in archive.values:
        with zipfile.ZipFile(path) as file:
            library = file.read(f"binaries/{FOLDER}/{path.stem}{ENDING}")
        (folder / path.stem).write_bytes(library)
    found: dict[str, dict[str, str]] = {path.stem: {} for path in archive.values}
    reported = subprocess.run(
        [nm, "-AD", *found], cwd=folder, capture_output=True, text=True, check=True
    )
    for line in reported.stdout.splitlines():
        name, _, about = line.partition(":")
        letter, symbol = about.split()[-2:]
        found[name][symbol.partition("@")[0]] = letter
    return archive.map(lambda path: found[path.stem])


@pytest.fixture(scope="session")
def instance(fmu) -> Each:
    """A fresh instance."""
    return fmu.within(Instance)


@pytest.fixture(scope="session")
def running(fmu) -> Each:
    """An instance after five steps, at t = 0.5 s of an experiment that ends at 100 s."""
    return fmu.within(_running)


class Elsewhere:
    """Sequences of calls in a process of their own, started again after a crash."""

    PATIENCE = 60.0

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None

    def run(self, archive: Path, sequence: list) -> list:
        """The answers; see tests/compliance/worker.py."""
        if self.process is None or self.process.poll() is not None:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.compliance.worker"],
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
        self.process.stdin.write(json.dumps([str(archive), sequence]).encode() + b"\n")
        self.process.stdin.flush()
        if not select.select([self.process.stdout], [], [], self.PATIENCE)[0]:
            self.process.kill()
        answer = self.process.stdout.readline()
        if not answer.startswith(b"["):
            report = (answer + self.process.communicate()[0]).decode(errors="replace")
            pytest.fail(
                f"the process ended with {self.process.returncode}: {report}", pytrace=False
            )
        return json.loads(answer)

    def close(self) -> None:
        if self.process is not None:
            self.process.communicate()


@pytest.fixture(scope="session")
def elsewhere() -> Iterator[Elsewhere]:
    with closing(Elsewhere()) as process:
        yield process


@contextmanager
def _running(fmu: Fmu) -> Iterator[Instance]:
    with Instance(fmu) as one:
        one.start(stop=100.0)
        one.simulate(5)
        yield one
