# SPDX-License-Identifier: BSD-2-Clause
"""Inputs that an FMU declares as optional: they hold their start value where they are
unconnected.
"""

from __future__ import annotations

import tomllib

import pytest

from harness import run
from harness.errors import StructureError
from harness.ssp import reader as ssp
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.system.model import Connection, Port
from tests.harness.third_party_fmu import Model, Var, build, p, u, y

pytestmark = pytest.mark.usefixtures("trusted")

LAW = "y = k * u + extra;"
OPTIONAL = Var("extra", "input", 5.0, "1", "Real", True)
MODELS = {
    "with": Model("with", [u("u"), OPTIONAL, y("y"), p("k", 1.0)], LAW),
    "without": Model("without", [u("u"), y("y"), p("k", 1.0)], "y = k * u;"),
    "required": Model("required", [u("u"), u("extra"), y("y"), p("k", 1.0)], LAW),
    "source": Model("source", [y("extra")], "extra = 7;"),
}
TOML = """
name = "demo"
[experiment]
stop = 2.0
step = 1.0
[components]
law = "FMU"
[open]
"law.u" = 1.0
"""


@pytest.fixture(scope="module")
def laws(tmp_path_factory):
    folder = tmp_path_factory.mktemp("optional")
    return {name: build(model, folder) for name, model in MODELS.items()}


@pytest.fixture
def system(laws):
    def of(fmu, text=TOML):
        return system_of(tomllib.loads(text.replace("FMU", fmu)), laws)

    return of


def last(result):
    return float(result["law.y"][-1])


def test_an_unconnected_optional_input_holds_its_start_value(system, caplog):
    assert last(run(system("with"))) == 1 + 5
    assert not caplog.messages


def test_an_unconnected_required_input_is_still_rejected(system):
    with pytest.raises(StructureError, match=r"law\.extra: no output of this name"):
        system("required")


def test_it_may_be_listed_as_open_with_a_value_or_set(system):
    assert last(run(system("with", TOML + '"law.extra" = 2.0'))) == 3
    assert last(run(system("with"), set=["law.extra=3"])) == 4


def test_it_is_wired_by_name_where_an_output_is_called_like_it(system):
    text = TOML.replace("[open]", 'other = "source"\n[open]')
    driven = system("with", text)
    assert driven.connections == (Connection(Port("other", "extra"), Port("law", "extra")),)
    assert last(run(driven)) == 1 + 7
    two = text.replace("[open]", 'third = "source"\n[open]')
    with pytest.raises(StructureError, match=r"law\.extra: ambiguous, other and third"):
        system("with", two)


@pytest.mark.parametrize(
    ("before", "after", "value"), [("without", "with", 6), ("with", "without", 1)]
)
def test_fmus_with_and_without_it_replace_each_other_without_a_message(
    system, laws, caplog, before, after, value
):
    assert last(run(system(before), swap={"law": laws[after]})) == value
    assert not caplog.messages


def test_nothing_is_reported_for_an_open_value_that_the_new_fmu_does_not_use(system, laws, caplog):
    listed = system("with", TOML + '"law.extra" = 2.0\n[parameters.law]\nk = 3')
    assert last(run(listed, swap={"law": laws["without"]})) == 3
    assert last(run(listed, swap={"law": laws["required"]})) == 5
    assert not caplog.messages


def test_a_swap_still_needs_required_inputs(system, laws):
    with pytest.raises(StructureError, match="its input extra: no output of this name"):
        run(system("without"), swap={"law": laws["required"]})


def test_a_driven_optional_input_stays_driven_through_a_file_and_a_swap(system, laws, tmp_path):
    driven = system("with", TOML.replace("[open]", 'other = "source"\n[open]'))
    write_ssp(driven, tmp_path / "demo.ssp")
    with ssp.opened(tmp_path / "demo.ssp") as found:
        assert last(run(found)) == 8
        assert last(run(found, swap={"law": laws["with"]})) == 8
        assert last(run(found, swap={"law": laws["without"]})) == 1
    write_ssp(system("with"), tmp_path / "alone.ssp")
    assert last(run(tmp_path / "alone.ssp")) == 6
