# SPDX-License-Identifier: BSD-2-Clause
"""Missions are folders: of the project, of users, of packages; the engine knows none of them, and
Python comes from nowhere else.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import harness
from harness import export, read, run
from harness.cli import main
from harness.errors import UsageError
from harness.files import paths
from harness.mission import library
from harness.results.result import Result

PACKAGE = Path(harness.__file__).parent
MISSIONS = PACKAGE.parent / "ssp"

CONVENTIONS = {"sample_period", "latency", "seed", "stream", "status"}
"""Words of signals that are the engine's own: what every FMU may have, and options of a run."""
WORDS = {"target", "assembly", "timeline"}
"""FMUs whose names are words of the language or of XML, distinguished by what they are part of."""


def names_of_missions():
    """Systems, FMUs, and signals that are no plain words."""
    systems = {p.name for p in MISSIONS.iterdir() if (p / "system.toml").is_file()}
    signals = set()
    for fmu in paths.fmus().values():
        with zipfile.ZipFile(fmu) as archive:
            root = ET.fromstring(archive.read("modelDescription.xml"))
        names = (v.get("name").partition("[")[0] for v in root.iter("ScalarVariable"))
        signals |= {n for n in names if not n.startswith("der(") and ("_" in n or not n.islower())}
    return systems | set(paths.fmus()) - WORDS, {s for s in signals if len(s) > 2} - CONVENTIONS


def texts_of(file):
    """All texts and all names of modules in a file, but for the docstrings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    reported = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in reported
        ):
            yield node.lineno, node.value
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, node.module or ""
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)


def test_the_engine_names_no_system_no_fmu_and_no_signal():
    named, signals = names_of_missions()
    components = "guidance|controller|monitor|propulsion|servicer|target|robot|assembly|allocation"
    found = []
    for file in sorted(PACKAGE.rglob("*.py")):
        for line, text in texts_of(file):
            words = set(re.findall(r"[A-Za-z_]\w*", text))
            of_components = rf"(?<![\w.-])(?:{components})\.(?!(?:c|md|py)\b)[a-z]\w*"
            hits = words & (named | signals) | set(re.findall(of_components, text))
            if hits:
                found.append(f"{file.relative_to(PACKAGE)}:{line}: {', '.join(sorted(hits))}")
    assert not found, "\n".join(found)


def test_the_engine_imports_no_mission():
    for file in PACKAGE.rglob("*.py"):
        assert not any(re.match(r"ssp(\.\w+)+$", text) for _, text in texts_of(file)), file


# ---- a mission of a user


@pytest.fixture
def alone(monkeypatch, tmp_path):
    """An empty folder, and a library that knows only what is installed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(library, "_named", {})
    monkeypatch.setattr(library, "_chosen", [])
    return tmp_path


def test_a_new_mission_runs_plots_and_reports_at_once(alone, capsys):
    assert main(["new", "mission", "mine"]) == 0
    assert main(["run", "mine", "--stop", "20", "-o", "mine.nc", "--quiet"]) == 0
    assert main(["report", "mine.nc", "--mission", "mine"]) == 1  # 20 s are too few for the paper
    out = capsys.readouterr().out
    assert "Claims of mine" in out
    assert "the run reaches its end" in out
    assert main(["plot", "mine.nc", "--mission", "mine", "-o", "figures"]) == 0
    assert (alone / "figures" / "own.png").is_file()
    assert main(["report", "mine.nc", "--mission", "mine", "-o", "mine.html"]) == 0
    page = (alone / "mine.html").read_text(encoding="utf-8")
    assert "A figure of my own" in page
    assert "my largest" in page


def test_a_mission_that_is_not_at_hand_leaves_the_general_figures_and_states_so(
    alone, capsys, caplog
):
    assert main(["new", "mission", "mine"]) == 0
    run("mine", stop=5.0).save("mine.nc")
    library._named.clear()
    assert main(["report", "mine.nc"]) == 0
    assert "the mission mine is not available" in " ".join(capsys.readouterr().out.split())
    assert main(["plot", "mine.nc", "-o", "figures"]) == 0
    assert "name its folder with --mission" in caplog.text
    assert "servicer" in capsys.readouterr().out


def test_a_mission_that_exists_is_not_overwritten(alone):
    assert main(["new", "mission", "mine"]) == 0
    assert main(["new", "mission", "mine"]) == 2
    assert main(["new", "mission", "sync_approach"]) == 2
    assert main(["new", "mission", "a b"]) == 2


def test_an_error_in_a_mission_module_is_one_line_with_its_place(alone, capsys):
    assert main(["new", "mission", "mine"]) == 0
    run("mine", stop=1.0).save("mine.nc")
    file = alone / "mine" / "mission.py"
    file.write_text(file.read_text(encoding="utf-8").replace('"my largest"', "my_largest"))
    library._loaded.cache_clear()
    for name in [n for n in sys.modules if n.startswith("mission_mine")]:
        del sys.modules[name]
    capsys.readouterr()
    assert main(["plot", "mine.nc", "--mission", "mine"]) == 1
    err = capsys.readouterr().err
    assert re.fullmatch(
        r"harness: .*mine/mission\.py, line \d+: NameError: name 'my_largest' is not defined.*\n",
        err,
    )


@pytest.mark.parametrize(
    ("offered", "wanted"),
    [
        ("figures=5", "line 9: TypeError: figures: expected tuple[Figure | Drawing, ...], got 5"),
        ("figures=(5,)", "line 9: TypeError: figures: expected tuple[Figure |"),
        ("metrics=metric(fails)", "line 5: ZeroDivisionError: division by zero"),
        ("metrics=metric(leaves)", "line 7: SystemExit: 0"),
        ("metrics=metric(lambda r, l: 'far')", "line 9: metric m is 'far', neither a number nor"),
        ("metrics=metric(lambda r, l: None)", "line 9: metric m is None, not a number"),
        ("metrics=metric(lambda r, l: r.time)", "line 9: metric m is an array of 3, not one"),
        ("figures=figure(fails)", "line 5: ZeroDivisionError: division by zero"),
        ("figures=figure(lambda r: None)", "line 9: expected an array of 3 rows for a curve"),
        ("figures=figure(lambda r: r.time[:1])", "line 9: expected an array of 3 rows for a"),
        ("notes=(fails,)", "line 5: ZeroDivisionError: division by zero"),
        ("notes=(leaves,), figures=(1 / 0,)", "line 9: ZeroDivisionError: division by zero"),
        ("figures=leaves()", "line 7: SystemExit: 0"),
        ("notes=(lambda r: 5,)", "line 9: expected an iterator of str, got 5"),
        ("notes=(lambda r: 'one',)", "line 9: expected an iterator of str, got 'one'"),
        ("notes=(lambda r: ['one', 2],)", "line 9: expected an iterator of str, got 2"),
        ("rules=(lambda r: [5],)", "line 9: expected an iterator of RuleFinding, got 5"),
        ("bands=(lambda *given: 5,)", "line 9: expected Limits, got 5"),
        ("exchange=(Exchange(remarks=lambda r: 5),)", "line 9: expected an iterator of str, got 5"),
        ("scene=(Scene((), (), lambda *g: 5),)", "line 9: expected dict, got 5"),
    ],
)
def test_mistakes_in_a_mission_are_reported_in_one_line_with_its_place(
    alone, capsys, offered, wanted
):
    lines = [
        "from harness.mission import *",
        "metric = lambda f: (Metric('m', 'm', (), f),)",
        "figure = lambda f: (Figure('f', 'F', (Panel('p [m]', (Curve(f),)),)),)",
        "def fails(*given):",
        "    1 / 0",
        "def leaves(*given):",
        "    raise SystemExit(0)",
        "",
        f"MISSION = Mission({offered})",
    ]
    (alone / "mine").mkdir()
    file = alone / "mine" / "mission.py"
    file.write_text("\n".join(lines), encoding="utf-8")
    columns = {"columns": ("a.b",), "units": ("m",), "values": np.arange(3.0)[:, None]}
    Result("simple", np.arange(3.0), **columns).save("simple.nc")
    assert main(["report", "simple.nc", "--mission", "mine", "-o", "page.html"]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"harness: {file}, {wanted}")
    assert error.count("\n") == 1
    assert not (alone / "page.html").exists()


def test_a_system_of_fmus_by_path_and_by_name_needs_no_other_mission(alone):
    folder = alone / "plain"
    folder.mkdir()
    (folder / "copied.fmu").write_bytes(paths.fmus()["target"].read_bytes())
    (folder / "system.toml").write_text(
        """[experiment]
stop = 10.0
step = 1.0
[components]
body = "copied.fmu"
[open]
"body.F_T" = [0, 0, 0]
"body.M_T" = [0, 0, 0]
"""
    )
    result = run(folder)
    assert result.provenance.mission == "plain"
    assert result.complete
    assert result.system == "plain"


# ---- a mission of a package


def test_a_package_offers_its_mission_by_an_entry_point(alone, monkeypatch):
    """A package that is on the path as an installed one is, run in a process of its own."""
    package = alone / "site" / "offered"
    package.mkdir(parents=True)
    info = alone / "site" / "offered-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: offered\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[harness.missions]\noffered = offered\n")
    (package / "__init__.py").write_text("")
    (package / "mission.py").write_text(
        "from harness.mission import Metric, Mission\n"
        "MISSION = Mission(metrics=(Metric('rows', '', (), lambda r, _: len(r.time)),))\n"
    )
    (package / "system.toml").write_text('extends = "sync_approach"\n')
    script = (
        "from harness import run; from harness.mission.library import of_result\n"
        "result = run('offered', stop=1.0)\n"
        "print(result.provenance.mission, [m.name for m in of_result(result).metrics])"
    )
    monkeypatch.setenv("PYTHONPATH", f"{alone / 'site'}")
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    assert done.stdout == "offered ['rows']\n"


# ---- no Python from data


def test_python_inside_an_archive_or_beside_a_result_is_never_run(alone):
    """A .ssp with a mission.py and a results file that names a folder: neither is taken."""
    evil = "import pathlib; pathlib.Path('was-run').write_text('')\n"
    (alone / "bait").mkdir()
    (alone / "bait" / "mission.py").write_text(evil)
    (alone / "mission.py").write_text(evil)
    archive = alone / "sync.ssp"
    export("sync_approach", archive)
    with zipfile.ZipFile(archive, "a") as file:
        file.writestr("mission.py", evil)
        file.writestr("resources/mission.py", evil)
    result = run(archive, stop=1.0)
    for name in ("os", "../bait", str(alone / "bait"), "bait"):
        known = result.provenance
        few = {name: getattr(result, name)[:3] for name in ("columns", "units", "descriptions")}
        few["values"] = result.values[:, :3]
        forged = replace(result, **few, provenance=replace(known, mission=name))
        forged.save("forged.nc")
        assert library.missing(read("forged.nc"))
        assert main(["report", "forged.nc"]) in {0, 1}
    assert main(["plot", "forged.nc", "-o", "figures"]) == 0
    assert not list(alone.rglob("was-run"))


def test_a_run_is_repeated_without_the_python_of_a_folder_that_only_the_file_names(alone):
    assert main(["new", "mission", "mine"]) == 0
    result = run("mine", stop=1.0)
    bait = alone / "bait"
    (alone / "mine").rename(bait)
    (bait / "mission.py").write_text("import pathlib; pathlib.Path('was-run').write_text('')\n")
    forged = replace(result, provenance=replace(result.provenance, source=str(bait)))
    forged.save("forged.nc")
    library._named.clear()
    main(["run", "--like", "forged.nc", "-o", "again.nc"])
    assert not (alone / "was-run").exists()


LEAST = """
from pathlib import Path
from harness.mission import Mission

class Least:
    verified = None
    def __init__(self, *given):
        self.given = given
    def lines(self):
        yield from map(str, self.given)
    def store(self):
        return Path("least.txt")

def other(system, *options):
    return None

def least(system, *options):
    return Least(system.name, system.experiment.stop, *options)

MISSION = Mission(bounds=(other, least))
"""


def test_a_mission_answers_what_a_run_would_have_cost_by_a_function_of_its_own(alone, capsys):
    """The first function that does not return None answers."""
    (alone / "mine").mkdir()
    (alone / "mine/system.toml").write_text('extends = "sync_approach"\nname = "mine"\n')
    (alone / "mine/mission.py").write_text(LEAST)
    assert main(["bound", "mine", "--stop", "5", "--grid", "2", "--store"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines() == ["mine", "5.0", "sum", "2.0", "()", "stored in least.txt"]
    assert main(["bound", "mine", "--cost", "norm", "--without", "wall", "-o", "x.nc"]) == 2
    found = capsys.readouterr()
    assert found.out.splitlines()[2:] == ["norm", "None", "['wall']"]
    assert "optima of phases are simulated one by one" in found.err
    assert not (alone / "x.nc").exists()


def test_a_mission_is_named_by_its_folder(alone):
    with pytest.raises(UsageError, match="there is no such folder"):
        library.use(alone / "nowhere")
    with pytest.raises(UsageError, match="holds neither"):
        library.use(alone)


@pytest.mark.parametrize("name", ["mine", "mine/system.toml"])
def test_a_folder_or_a_toml_is_accepted_wherever_a_system_is(alone, capsys, name):
    assert main(["new", "mission", "mine"]) == 0
    for command in (["check"], ["show"], ["list"], ["draw"]):
        assert main([*command, name]) == 0, command
    assert main(["export", name, "mine.ssp"]) == 0
    assert run("mine.ssp", stop=1.0).provenance.mission == "mine"
    (alone / "own.toml").write_text(
        f'system = "{name}"\nruns = 2\n[factors]\n'
        '"servicer.mass_0" = {uniform = {low = 90, high = 110}}\n'
        '[metrics]\nlargest = "my largest"\n[fixed]\nstop = 1.0\n'
    )
    capsys.readouterr()
    assert main(["campaign", "own.toml", "-o", "own.zarr", "--workers", "0"]) == 0
    assert "largest" in capsys.readouterr().out
