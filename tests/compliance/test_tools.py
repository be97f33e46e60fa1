# SPDX-License-Identifier: BSD-2-Clause
"""Reports of other checkers on every FMU: VDMCheck2 (both of its models) and the FMU manipulation
toolbox.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.compliance.fmus import ARCHIVES

VERSION = "1.1.3"
GROUP = "org/into-cps/vdmcheck"
JARS = {
    "vdmcheck2.jar": f"{GROUP}/fmi2/vdmcheck2/{VERSION}/vdmcheck2-{VERSION}.jar",
    "xsd2vdm.jar": f"{GROUP}/xsd2vdm/{VERSION}/xsd2vdm-{VERSION}.jar",
    "fmuReader.jar": f"{GROUP}/fmuReader/{VERSION}/fmuReader-{VERSION}.jar",
    "vdmj.jar": "dk/au/ece/vdmj/vdmj/4.5.0/vdmj-4.5.0.jar",
    "annotations.jar": "dk/au/ece/vdmj/annotations/4.5.0/annotations-4.5.0.jar",
}
MODELS = {
    "static": f"{GROUP}/fmi2/static-model/{VERSION}/static-model-{VERSION}.jar",
    "rules": f"{GROUP}/fmi2/rule-model/{VERSION}/rule-model-{VERSION}.jar",
}
"""Folders in which Maven stores the parts of VDMCheck2; it looks for its parts under the short
names, beside itself.
"""

pytestmark = pytest.mark.interop
vdmcheck = pytest.mark.tool("VDMCheck2", VERSION)
toolbox = pytest.mark.tool("FMU manipulation toolbox", "fmu-manipulation-toolbox")
both_models = pytest.mark.parametrize("model", MODELS)


def cache():
    """Folder for downloads that outlive a test run."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "servicing-fmus"


def run(*command, **options):
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=600, check=False, **options
    )
    return done.returncode, done.stdout + done.stderr


# ---- VDMCheck2


def java_version():
    if shutil.which("java") is None:
        pytest.skip("Java is not installed: VDMCheck2 was not run")
    found = re.search(r'version "(\d+)', run("java", "-version")[1])
    return int(found[1]) if found else 0


def fetch(repository):
    """Download by Maven into `repository`, unless it is all there."""
    parts = [repository / path for path in (*JARS.values(), *MODELS.values())]
    if all(path.is_file() for path in parts):
        return
    if shutil.which("mvn") is None:
        pytest.skip("Maven is not installed: VDMCheck2 was not run")
    artifact = f"-Dartifact=org.into-cps.vdmcheck.fmi2:vdmcheck2:{VERSION}"
    code, report = run(
        "mvn", "-q", "-B", f"-Dmaven.repo.local={repository}", "dependency:get", artifact
    )
    if code or not all(path.is_file() for path in parts):
        pytest.skip(
            f"VDMCheck2 cannot be had from Maven Central: {' '.join(report.split())[-200:]}"
        )


@pytest.fixture(scope="session")
def checkers(tmp_path_factory):
    """vdmcheck2.jar for each of the two models, in a folder as the distribution of VDMCheck2 has
    it.
    """
    if java_version() < 17:
        pytest.skip("Java is older than 17: VDMCheck2 was not run")
    repository = cache() / "maven"
    fetch(repository)
    folders = {}
    for name, model in MODELS.items():
        folder = tmp_path_factory.mktemp(name)
        for short, path in JARS.items():
            shutil.copy(repository / path, folder / short)
        for jar in (
            repository / model,
            folder / "vdmcheck2.jar",
        ):  # the model, and the schema of FMI 2.0
            with zipfile.ZipFile(jar) as files:
                files.extractall(folder)
        folders[name] = folder / "vdmcheck2.jar"
    return folders


def verdict(checker, fmu):
    """Last line and whole report; the exit code is meaningless."""
    report = run("java", "-jar", checker, fmu, cwd=checker.parent)[1].strip()
    return report.splitlines()[-1], report


@vdmcheck
@both_models
def test_vdmcheck_finds_no_errors(checkers, archive, model):
    last, report = verdict(checkers[model], archive)
    assert last == "No errors found.", report


def spoiled(archive, folder, old, new):
    """A copy with a changed model description."""
    path = folder / archive.name
    with zipfile.ZipFile(archive) as good, zipfile.ZipFile(path, "w") as bad:
        for entry in good.infolist():
            data = good.read(entry)
            if entry.filename == "modelDescription.xml":
                assert old in data
                data = data.replace(old, new, 1)
            bad.writestr(entry, data)
    return path


SPOILED = {
    "unit that is not defined": (b' unit="', b' unit="furlong'),
    "output without an entry": (b'<Unknown index="', b'<Unknown index="9'),
}


@vdmcheck
@both_models
@pytest.mark.parametrize("fault", SPOILED)
def test_vdmcheck_reports_planted_errors(checkers, model, fault, tmp_path):
    last, report = verdict(checkers[model], spoiled(ARCHIVES[0], tmp_path, *SPOILED[fault]))
    assert last != "No errors found.", report


# ---- FMU manipulation toolbox


@pytest.fixture(scope="session")
def fmutool():
    beside = Path(sys.executable).with_name("fmutool")
    found = beside if beside.is_file() else shutil.which("fmutool")
    if found is None:
        pytest.skip("fmu-manipulation-toolbox is not installed")
    return found


def complaints(fmutool, archive, folder):
    """Lines of the report that are above INFO, and whether all checks have given their blessing."""
    code, report = run(fmutool, "-input", archive, "-check", cwd=folder)
    lines = [line for line in report.splitlines() if not line.startswith("INFO")]
    blessed = "seems to be compliant with FMI-2.0" in report and "No semantic error" in report
    return code, lines, blessed, report


@toolbox
def test_fmutool_reports_no_problem(fmutool, archive, tmp_path):
    code, lines, blessed, report = complaints(fmutool, archive, tmp_path)
    assert (code, lines, blessed) == (0, [], True), report


@toolbox
def test_fmutool_reports_planted_errors(fmutool, tmp_path):
    bad = spoiled(ARCHIVES[0], tmp_path, b' causality="output"', b' causality="outlet"')
    assert complaints(fmutool, bad, tmp_path)[1:3] != ([], True)
