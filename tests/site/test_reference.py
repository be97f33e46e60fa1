# SPDX-License-Identifier: BSD-2-Clause
"""The reference has everything that the code has: commands, options, keys, public names, ports."""

from __future__ import annotations

import importlib.util
import inspect
import re
import zipfile
from importlib import import_module

import pytest
from fmpy import read_model_description

from harness.cli import main
from harness.figures import diagram
from harness.files import paths
from harness.mission.library import places, systems_in
from harness.ssp import build
from harness.ssp.library import load
from harness.studies.analyses import sensitivity, worst
from harness.studies.campaign import factors, plan

HEAD = b"<?xml"


@pytest.fixture(scope="module")
def commands(writer):
    return dict(writer["commands"].pages())


@pytest.fixture(scope="module", params=[4, pytest.param(1, marks=pytest.mark.long)])
def missions(writer, request):
    """With the diagrams of every fourth system; of the others the head alone."""
    drawn = sorted(paths.systems())[:: request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            diagram, "painted", lambda s, f=diagram.painted: f(s) if s.name in drawn else HEAD
        )
        return dict(writer["missions"].pages({}, {}))


@pytest.fixture(scope="module")
def models(writer):
    parts = {letter: page for letter, (_, page) in writer["missions"].equations().items()}
    return dict(writer["models"].pages({}, parts))


def printed(capsys, *arguments):
    assert main(list(arguments)) == 0
    return capsys.readouterr().out


def listed(text):
    """Names at the beginning of the lines of a help below "Commands"."""
    return re.findall(r"^  ([a-z]+)\b", text.partition("Commands:")[2], re.MULTILINE)


def test_every_command_has_a_page_with_all_of_its_options(commands, capsys):
    names = listed(printed(capsys, "--help"))
    assert len(names) > 15
    assert {f"reference/commands/{n}.md" for n in (*names, "index")} == set(commands)
    for name in names:
        page = commands[f"reference/commands/{name}.md"]
        column = re.findall(r"^  (-.*?)(?:  |$)", printed(capsys, name, "--help"), re.MULTILINE)
        known = set(re.findall(r"--[a-z][a-z-]*", " ".join(column)))
        assert "--help" in known
        missing = [option for option in known - {"--help"} if f"`{option}`" not in page]
        assert not missing, f"{name}: {missing}"


def test_every_key_of_a_system_is_in_the_reference_and_no_other(writer):
    ours = {name: set(entries) for name, entries in writer["keys"].SYSTEM.items()}
    tables = {
        "": build.Source, "experiment": build.Time, "schedule.COMPONENT": build.Timing,
        "sets.NAME": build.Set, "sets.NAME.experiment": build.SetTime,
        "alternatives.FMU": build.Replacement,
        "compare": build.Compared, "live": build.Live,
    }  # fmt: skip
    assert ours == {name: set(kind.__struct_fields__) for name, kind in tables.items()}


def test_every_key_of_a_campaign_is_in_the_reference_and_no_other(writer):
    ours = {name: set(entries) for name, entries in writer["keys"].CAMPAIGN.items()}
    assert ours == {
        "": set(plan.Table.__struct_encode_fields__),
        "fixed": set(plan.Fixed.__struct_encode_fields__),
        "factors.NAME": set(factors.Varied.__struct_encode_fields__),
        "record": set(plan.Record.__struct_encode_fields__),
        "sensitivity": set(sensitivity.Sensitivity.__struct_fields__),
        "worst": set(worst.Worst.__struct_fields__),
    }


def test_the_pages_of_the_keys_hold_all_of_them(writer):
    for (_, page), keys in zip(
        writer["keys"].pages(), (writer["keys"].SYSTEM, writer["keys"].CAMPAIGN), strict=True
    ):
        assert all(f"| `{key}` |" in page for entries in keys.values() for key in entries)


def test_every_public_name_is_in_the_reference_and_documented(writer):
    python = writer["python"]
    pages = dict(python.pages())
    for package, (file, _, _) in python.PACKAGES.items():
        assert python.names(package)
        for name in python.names(package):
            found = getattr(import_module(package), name)
            assert inspect.getdoc(found), f"{package}.{name} has no docstring"
            assert f"::: {python.home(package, name)}" in pages[f"reference/{file}"]


def test_every_port_and_parameter_is_on_the_page_of_its_fmu(models):
    assert {f"reference/fmus/{name}.md" for name in (*paths.fmus(), "index")} == {
        name for name in models if name.endswith(".md")
    }
    for name, path in paths.fmus().items():
        page = models[f"reference/fmus/{name}.md"]
        rows = dict(re.findall(r"<tr><td>([\w.]+)</td>(.*?)</tr>", page))
        for variable in read_model_description(str(path)).modelVariables:
            row = rows[variable.name.partition("[")[0]]
            assert f"<td>{variable.unit}</td>" in row, f"{name}.{variable.name}"
            if variable.causality == "parameter":
                assert variable.start in row, f"{name}.{variable.name}"
    assert all(name in models["reference/fmus/index.md"] for name in paths.fmus())


def test_every_mission_has_a_page_with_its_systems_and_sets(missions):
    for name, place in places().items():
        for system in systems_in(place.folder):
            page = missions[f"reference/missions/{name}.md"]
            assert missions[f"reference/missions/{system}.svg"].startswith(b"<?xml")
            with load(paths.systems()[system]) as found:
                assert all(f"| `{s.name}` |" in page for s in found.sets)
                assert all(f"| `{c.name}` |" in page for c in found.components)


def test_the_page_of_the_site_and_the_page_in_the_fmu_have_the_same_chapters(models, writer):
    for name, path in paths.fmus().items():
        with zipfile.ZipFile(path) as archive:
            inside = archive.read("documentation/index.html").decode()
        page = models[f"reference/fmus/{name}.md"]
        plain = re.sub(r'<a href="[^"]*">([A-L](?:\.\d+)?)</a>', r"docs/models.md \1", page)
        for title, body in re.findall(r"<h2>(.*?)</h2>(.*?)\n(?=<)", inside, re.DOTALL):
            assert f"## {title}\n" in page
            assert body in plain, f"{name}: {title}"


def test_no_page_is_longer_than_300_lines_and_links_lead_somewhere(
    writer, commands, models, missions
):
    from text import ROOT

    pages = sorted((ROOT / "docs").rglob("*.md"))
    assert len(pages) > 30
    for page in (*pages, *(ROOT / "ssp").glob("*/*.md")):
        assert len(page.read_text(encoding="utf-8").splitlines()) <= 300, page
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 60
    for name, text in (commands | models | missions).items():
        assert isinstance(text, bytes) or text.count("\n") <= 300, name
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages, *(ROOT / "lab").glob("*")):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            generated = "reference/" in target or page.name in {"index.md"}
            assert generated or (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_link_of_a_page_leads_to_a_page_of_the_site(writer):
    """Folders and files that the site does not show are no targets."""
    import text

    folder = text.ROOT / ".ci/pages"
    homes = importlib.util.spec_from_file_location("site_pages", folder / "__main__.py")
    module = importlib.util.module_from_spec(homes)
    homes.loader.exec_module(module)
    known = module.homes()
    assert len(known) > 80
    for source, page in known.items():
        if source.endswith(".md") and source != "README.md":
            text.relinked((text.ROOT / source).read_text(encoding="utf-8"), source, page, known)


def test_a_mission_begins_with_its_own_system(writer, missions):
    for name in writer["missions"].names():
        with load(paths.systems()[name]) as found:
            assert missions[f"reference/missions/{name}.md"].splitlines()[2] == found.description


def test_every_page_has_an_entry_in_the_navigation(writer):
    import yaml
    from text import ROOT

    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    entries = set(re.findall(r"[\w/*.]+\.md", yaml.safe_dump(yaml.safe_load(text)["nav"])))
    docs = ROOT / "docs"
    shown = {p for e in entries for p in docs.glob(e)}
    missing = [p.name for p in docs.rglob("*.md") if p not in shown]
    assert not missing, f"no entry in the navigation of mkdocs.yml: {missing}"
