# SPDX-License-Identifier: BSD-2-Clause
"""Every block of TOML and Python that a page shows, and the changes of every command, fit what is
there: systems, components, parameters, variables, functions. Whole pages run in test_tutorial.py
and in tests/journeys.
"""

from __future__ import annotations

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import pytest

from harness import campaign as run_campaign
from harness.files import paths
from harness.master.changes import apply
from harness.report.live import read_lesson
from harness.results.expressions import parsed
from harness.results.requirements import rejected
from harness.ssp.library import load
from harness.studies.campaign.draft import read_plan
from harness.studies.campaign.worker import COMPLETE
from harness.system.graph import read_interfaces
from tests.each import Each
from tests.site.test_commands_of_the_pages import COMMANDS, PAGES, commands_of

FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?<=\n\n)((?: {4}[^\n]*\n|\n(?= {4}))+)")
NAME = re.compile(r"\b([a-z]\w*)\.([A-Za-z]\w*)")
OF_OTHERS = ("mine.py", "harness.missions")
"""Names with a point that are a file or an entry point."""


class Block(NamedTuple):
    """Block of a page: the page, its text, and the TOML or Python in it."""

    page: str
    text: str
    content: Any


def blocks() -> Iterator[Block]:
    """Yield the blocks of all pages, fenced ones and indented ones, without indentation."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        found = [(kind, body) for kind, body in FENCED.findall(text) if kind in ("toml", "python")]
        bare = FENCED.sub("", text)
        found += [("", re.sub(r"^ {4,8}", "", m[1], flags=re.M)) for m in INDENTED.finditer(bare)]
        for kind, body in found:
            if (content := content_of(kind, body)) is not None:
                yield Block(page.name, body, content)


def content_of(kind: str, body: str) -> Any:
    """Return a table of TOML, the tree of Python, or None for other texts."""
    try:
        return tomllib.loads(body) or None
    except tomllib.TOMLDecodeError as error:
        assert kind != "toml", f"{body}: {error}"
    try:
        tree = ast.parse(body)
    except SyntaxError:
        assert kind != "python", body
        return None
    return (
        tree if any(isinstance(node, ast.Import | ast.ImportFrom) for node in tree.body) else None
    )


NAMED = ("sync_approach_thrusters_navigated", "relay_approach", "ppc_tracking", "arch_rendezvous")
"""Systems whose names the pages use."""
BLOCKS = list(blocks())
TABLES = [b for b in BLOCKS if isinstance(b.content, dict)]


@cache
def known() -> dict[str, set[str]]:
    """Return the names of variables and parameters by the name of a component, of the systems of
    the pages.
    """
    found: dict[str, set[str]] = {}
    for name in NAMED:
        with load(name) as system:
            for name, interface in read_interfaces(system).items():
                names = {re.split(r"[.\[]", v)[0] for v in interface.variables}
                found.setdefault(name, set()).update(names)
    return found


def test_blocks_are_found():
    assert len(TABLES) >= 10
    assert len(BLOCKS) - len(TABLES) >= 4
    assert sum("runs" in b.content for b in TABLES) >= 2


@pytest.fixture
def campaign():
    found = [b for b in TABLES if "system" in b.content and "exercises" not in b.content]
    return Each(found, lambda b: b.page)


def test_a_campaign_of_a_page_has_no_problem(campaign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("def spread(result):\n    return 0.0\n")
    file = tmp_path / "campaign.toml"
    text = campaign.text if "runs" in campaign.content else f"runs = 4\n{campaign.text}"
    file.write_text(text.replace('executor = "fused"', 'executor = "c"'))  # without its compilation
    read_plan(file)


def test_every_run_of_a_campaign_of_a_page_completes(campaign, tmp_path, monkeypatch):
    """One draw of each combination, two macro steps long: the draws are values that FMUs accept."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("def spread(result):\n    return 0.0\n")
    fixed = dict(campaign.content.get("fixed", {}))
    with load(campaign.content["system"]) as system:
        fixed["stop"] = 2 * fixed.get("step", system.experiment.step)
    short = {"runs": 1, "executor": "c", "fixed": fixed, "sampler": "random"}
    drawn = ("system", "seed", "factors", "seeds")
    table = {key: value for key, value in campaign.content.items() if key in drawn} | short
    found = run_campaign(table, tmp_path / f"{campaign.page}.zarr")
    assert (found.data.status == COMPLETE).all(), campaign.page


def test_the_lesson_of_a_page_is_one(tmp_path):
    (block,) = (b for b in TABLES if "exercises" in b.content)
    (tmp_path / "lesson.toml").write_text(block.text)
    lesson = read_lesson(tmp_path / "lesson.toml")
    with load(lesson.system) as system:
        assert rejected(system, {each.question: each.solved for each in lesson.exercises}) == []
        assert all(set(each.settings) <= set(system.sliders) for each in lesson.exercises)


@pytest.fixture
def table():
    return Each(TABLES, lambda b: f"{b.page}: {b.text[:40]!r}")


def test_every_variable_of_a_table_is_one_of_a_system(table):
    for component, variable in NAME.findall(re.sub(r"#.*|https?://\S+", "", table.text)):
        if component in known():
            assert variable in known()[component], f"{component}.{variable}"


def test_every_requirement_of_a_table_is_an_expression(table):
    for text in table.content.get("requirements", {}).values():
        parsed(text)


@pytest.fixture
def script():
    return Each([b for b in BLOCKS if isinstance(b.content, ast.Module)], lambda b: b.page)


def test_everything_that_a_script_imports_of_the_harness_is_there(script):
    for node in ast.walk(script.content):
        if isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] == "harness":
            module = importlib.import_module(str(node.module))
            assert not [n.name for n in node.names if not hasattr(module, n.name)]


def changed() -> list[tuple[str, str, dict[str, Any]]]:
    """Return page, system and changes of the commands that change a system of the project with FMUs
    of the project.
    """
    found = []
    for page in PAGES:
        for name, *words in commands_of(page):
            params = COMMANDS[name].make_context(name, words).params
            system = str(params.get("system"))
            changes = {
                k: params[k] for k in ("params", "set", "latency", "require") if params.get(k)
            }
            if name in ("run", "check") and system in paths.systems() and changes:
                shown = str(changes.get("params", ""))
                if shown.endswith((".toml", ".ssv")) or params.get("swap"):
                    continue
                found.append((page.name, system, changes))
    return found


@pytest.fixture
def change():
    return Each(changed(), str)


def test_changes_of_commands_are_found():
    assert len(changed()) > 10


def test_every_change_of_a_command_of_a_page_is_accepted(change):
    _, system, changes = change
    with load(system) as found:
        apply(found, **changes)


def test_the_tumble_of_the_tutorial_is_twice_the_nominal_one():
    (given,) = (c["set"][0] for page, _, c in changed() if page == "tutorial.md" and "set" in c)
    rates = [float(x) for x in re.findall(r"[\d.]+(?=[,\]])", given.partition("=")[2])]
    names = [f"omega_TN_T_0[{k}]" for k in (1, 2, 3)]
    with load("sync_approach") as system:
        parameters = system.component("target").parameters
    assert rates == [2 * float(parameters[n].value) for n in names]


def test_a_variable_that_is_none_is_noticed():
    assert "sigma_SN_0" in known()["servicer"]
    assert "q_SN_0" not in known()["servicer"]
