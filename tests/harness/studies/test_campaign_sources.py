# SPDX-License-Identifier: BSD-2-Clause
"""Everything that decides the runs of a campaign or study: once a single one of these files has
changed, its dataset is not continued, and the message names the file.
"""

from __future__ import annotations

import shutil
import zipfile
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import pytest

from harness import campaign, sensitivity, worst
from harness.errors import RequirementError, UsageError
from harness.files import paths
from harness.mission import library
from harness.studies.campaign import sources
from harness.studies.campaign.campaign import like
from harness.studies.campaign.store import Store
from tests.harness.mission.test_exchange import ISS

SYSTEM = """
extends = "base"
[experiment]
stop = 0.2
"""
BASE = """
extends = "sync_approach"
[start]
target = "iss.tle"
"""
MISSION = """
from harness.mission import Metric, Mission
from .numbers import TWICE
def scaled(result, limits):
    return TWICE * float(result["guidance.range"][-1])
MISSION = Mission(metrics=(Metric("scaled range", "m", ("guidance.range",), scaled),))
"""
CAMPAIGN = """
system = "mine/system.toml"
[factors]
"params" = {list = ["light.toml", "heavy.toml"]}
"swap.guidance" = {list = ["a/sync_guidance.fmu", "b/sync_guidance.fmu"]}
[metrics]
range = "mine.py:last_range"
scaled = "scaled range"
"""
FILES = {
    "mine/system.toml": SYSTEM,
    "mine/base.toml": BASE,
    "mine/iss.tle": ISS,
    "mine/mission.py": MISSION,
    "mine/numbers.py": "from whole import TWICE\n",
    "mine.py": "import parts.factor\ndef last_range(r):\n    from zero import ZERO\n"
    "    return ZERO + parts.factor.ONE * r['guidance.range'][-1]\n",
    "parts/factor.py": "from .one import ONE\n",  # a package without __init__.py
    "parts/one.py": "ONE = 1.0\n",
    "lib/zero.py": "ZERO = 0.0\n",
    "lib/whole.py": "TWICE = 2.0\n",
    "light.toml": "[servicer]\nmass_0 = 90.0\n",
    "heavy.toml": "[servicer]\nmass_0 = 110.0\n",
}
STUDY = """
system = "mine/system.toml"
[fixed]
params = "light.toml"
swap = {guidance = "a/sync_guidance.fmu"}
[factors]
"servicer.mass_0" = {normal = {mean = 100.0, sigma = 5.0}}
[requirements]
light = "guidance.range > 0 and parameter(servicer.mass_0) >= 99"
[sensitivity]
of = "light"
runs = 8
[worst]
of = "light"
runs = 24
"""
FMUS = {
    "a/sync_guidance.fmu": "sync_guidance",
    "b/sync_guidance.fmu": "sync_guidance",
    "build/fmus/servicer.fmu": "servicer",
}


@contextmanager
def inside(folder):
    """Work in a folder, with the FMUs that it brings along."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(library, "_named", {})
        patch.setenv("SERVICING_FMUS_BUILD", str(folder / "build"))
        patch.syspath_prepend(folder)
        patch.syspath_prepend(folder / "lib")
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A mission with all kinds of files, and a campaign and a study over it."""
    folder = tmp_path_factory.mktemp("begun")
    for name, text in {**FILES, "c.toml": CAMPAIGN, "s.toml": STUDY}.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    for name, fmu in FMUS.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(paths.fmus()[fmu], folder / name)
    with inside(folder):
        campaign("c.toml", "c.zarr", workers=0)
        sensitivity("s.toml", "s.zarr", workers=0)
    return folder


@pytest.fixture
def place(begun, tmp_path):
    """A copy of all: what has moved as a whole is the same."""
    with inside(shutil.copytree(begun, tmp_path / "place")) as folder:
        yield folder


def change(file):
    """Change the bytes of a file and no number that it holds."""
    if file.suffix == ".fmu":
        with zipfile.ZipFile(file, "a") as archive:
            archive.comment = b"changed"
    else:
        file.write_text(file.read_text() + "\n# changed\n")


def rejection(run, *given):
    with pytest.raises(UsageError, match="cannot resume: changed since its first run: ") as caught:
        run(*given, workers=0, resume=True)
    return str(caught.value).partition("first run: ")[2].partition(";")[0]


def rejected_after_any_change(place, run, *given, left_out=()):
    """Every file in turn, but for those that decide nothing."""
    for name in {*FILES, *FMUS} - {*left_out}:
        before = (place / name).read_bytes()
        change(place / name)
        shown = rejection(run, *given)
        assert name.endswith(shown), name
        assert Path(shown).name == Path(name).name
        (place / name).write_bytes(before)
    for name in left_out:
        change(place / name)
    run(*given, workers=0, resume=True)


def test_a_campaign_is_not_continued_after_any_single_file_has_changed(place):
    assert len(set(Store.open(Path("c.zarr")).array("range"))) == 2  # of the masses
    rejected_after_any_change(place, campaign, "c.toml", "c.zarr")


def test_a_study_is_not_continued_after_any_single_file_has_changed(place):
    others = ("mine.py", "parts/factor.py", "parts/one.py", "lib/zero.py")
    others += ("heavy.toml", "b/sync_guidance.fmu")
    rejected_after_any_change(place, sensitivity, "s.toml", "s.zarr", left_out=others)


def test_changed_entries_of_the_table_are_named(place):
    for before, after, names in (
        ("[factors]", "runs = 2\n[factors]", "runs"),
        ('["light.toml"', '["heavy.toml"', "factors.params, light.toml"),
        ("scaled =", "other =", "metrics.scaled, metrics.other"),
        ("[metrics]", "[fixed]\nalgorithm = 'jacobi'\n[metrics]", "fixed.algorithm"),
    ):
        assert before in CAMPAIGN
        (place / "c.toml").write_text(CAMPAIGN.replace(before, after))
        assert rejection(campaign, "c.toml", "c.zarr") == names
    (place / "s.toml").write_text(STUDY.replace(">= 99", ">= 98"))
    assert rejection(sensitivity, "s.toml", "s.zarr") == "requirements.light"
    with pytest.raises(UsageError, match="it is not the dataset of a worst"):
        worst("s.toml", "s.zarr", workers=0, resume=True)


def test_python_that_cannot_be_followed_costs_no_campaign(tmp_path):
    """What only would be imported, has errors, or would climb out of all folders."""
    (tmp_path / "broken.py").write_text("def (:")
    (tmp_path / "climbs.py").write_text(f"from {'.' * 99} import nowhere")
    text = "try:\n    import broken, climbs, nowhere, harness.api\nexcept Exception: pass\n"
    (tmp_path / "mine.py").write_text(text)
    found = {path.name for path in sources._imported(tmp_path / "mine.py")}
    assert found == {"mine.py", "broken.py", "climbs.py"}


def test_another_version_does_not_continue(place, monkeypatch):
    for package in sources.PACKAGES:
        other = {package: "99"}
        monkeypatch.setattr(sources, "version", lambda name, o=other: o.get(name) or version(name))
        assert rejection(campaign, "c.toml", "c.zarr") == f"version of {package}"


def test_a_file_that_decides_nothing_may_change_and_a_new_one_of_the_mission_may_not(place):
    (place / "mine" / "README.md").write_text("more")
    (place / "mine" / "another.toml").write_text("name = 'another'")
    (place / "unrelated.py").write_text("")
    campaign("c.toml", "c.zarr", workers=0, resume=True)
    (place / "mine" / "more.py").write_text("")
    assert rejection(campaign, "c.toml", "c.zarr") == "more.py"


def test_a_file_that_changes_while_the_campaign_runs_is_reported(place):
    def meanwhile(_):
        (place / "parts/one.py").write_text("ONE = 2.0\n")

    line = "one.py: changed while the campaign ran, so runs may have used either version"
    with pytest.raises(RequirementError, match=line) as caught:
        campaign("c.toml", "d.zarr", workers=0, progress=meanwhile)
    assert caught.value.partial.store.runs == 4


def test_files_that_differ_in_a_repeated_run_are_named(begun, caplog):
    shutil.copy(begun / "light.toml", begun / "before")
    with inside(begun):
        like("c.zarr#1")
        assert not caplog.messages
        change(begun / "light.toml")
        (begun / "parts/one.py").rename(begun / "gone")
        like("c.zarr#1")
    shutil.copy(begun / "before", begun / "light.toml")
    (begun / "gone").rename(begun / "parts/one.py")
    names = ("light.toml", "one.py")
    text = "has changed since run 1 of c.zarr"
    assert caplog.messages == [f"{name}: {text}" for name in names]


def test_a_run_of_another_system_is_rejected_as_it_was_typed(begun):
    """Although a file has changed, about which there is a line of its own."""
    with inside(begun):
        before = Path("parts/one.py").read_text()
        change(Path("parts/one.py"))
        with pytest.raises(UsageError, match=r"^--like c\.zarr#1: this run is of .*sync_approach$"):
            like("c.zarr#1", "sync_approach")
        Path("parts/one.py").write_text(before)
