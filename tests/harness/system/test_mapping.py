# SPDX-License-Identifier: BSD-2-Clause
"""--map: ports of a swapped FMU under names of its own; what is given is done, what differs in the
style of its indices is found, anything else is offered and never done.
"""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness import campaign, compare, export, run
from harness.cli.app import main
from harness.errors import HarnessError, StructureError, UsageError
from harness.master.changes import apply
from harness.ssp.build import system_of
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.system.graph import read_interfaces
from harness.system.mapping import by_style, families, given_names
from harness.system.problems import problems
from harness.system.values import Variable
from tests.harness.third_party_fmu import Model, build, p, u, y

TOML = """
name = "chain"
[experiment]
stop = 4.0
step = 1.0
[components]
from = "source"
to = "ours"
last = "vector"
[connections]
"to.v" = "from.v"
"last.v" = "to.w"
[parameters.to]
k = [1, 2, 3]
[parameters.last]
J = [[1, 0], [0, 1]]
"""
LAW = "{w1} = {k1} * {v1}; {w2} = {k2} * {v2}; {w3} = {k3} * {v3};"

NO_PORT = "no FMU that --swap puts in has such a port"


def model(name, v, w, k="k_{}", first=1):
    """An FMU that multiplies the elements of its input by the elements of its parameter; the names
    are patterns for an index.
    """
    places = range(first, first + 3)
    ports = [
        *(u(v.format(i), "m") for i in places),
        *(y(w.format(i), "m") for i in places),
        *(p(k.format(i), 9.0) for i in places),
    ]
    in_c = {
        f"{letter}{n + 1}": re.sub(r"\W+", "_", pattern.format(i)).strip("_")
        for letter, pattern in (("v", v), ("w", w), ("k", k))
        for n, i in enumerate(places)
    }
    return Model(name, ports, outputs=LAW.format(**in_c))


MODELS = [
    model("ours", "v[{}]", "w[{}]", "k[{}]"),
    model("zero", "v[{}]", "w[{}]", "k[{}]", first=0),
    model("under", "v_{}", "w_{}", "k_{}"),
    model("other", "speed_out[{}]", "w_out[{}]", "k[{}]"),
]


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """FMUs that do the same under other names, by name."""
    folder = tmp_path_factory.mktemp("others")
    return {m.name: build(m, folder) for m in MODELS}


@pytest.fixture
def chain(fmus, others, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_ssp(system_of(tomllib.loads(TOML), fmus | others), tmp_path / "chain.ssp")
    return tmp_path / "chain.ssp"


EXPECTED = np.outer(np.arange(5.0), [1 * 1, 10 * 2, 100 * 3])
"""The source counts n, 10 n, 100 n; the component multiplies by 1, 2, 3."""


def test_the_system_itself(chain):
    assert run(chain)["to.w"].tolist() == EXPECTED.tolist()


@pytest.mark.parametrize("name", ["zero", "under"])
def test_indices_in_another_style_are_found_and_reported_with_the_parameters(
    chain, others, caplog, name
):
    result = run(chain, swap={"to": others[name]}, in_process=True)
    assert result["last.w"].tolist() == EXPECTED.tolist()
    (note,) = [m for m in caplog.messages if "writes indices in another style" in m]
    first = {"zero": "v[0].. for v[1]..", "under": "v_1.. for v[1].."}[name]
    assert first in note


def test_other_names_are_not_taken_but_listed(chain, others, capsys):
    command = ["run", "chain.ssp", "-q", "-o", "x.nc", "--swap", f"to={others['other']}"]
    assert main(command) == 1
    lines = capsys.readouterr().err.splitlines()
    assert "it has no output w" in "\n".join(lines)
    assert "ports speed_out, w_out match no signal; connect each by --map" in lines[-1]
    assert main([*command, "--map", "speed_out=v", "--map", "w_out=w"]) == 0


def test_names_are_mapped_for_whole_vectors_and_for_elements(chain, others):
    whole = ["speed_out=v", "w_out=w"]
    single = ["speed_out=v", "w_out[1]=w[3]", "w_out[2]=w[2]", "w_out[3]=w[1]"]
    swap = {"to": others["other"]}
    simulated = run(chain, swap=swap, map=whole, in_process=True)
    assert simulated["last.w"].tolist() == EXPECTED.tolist()
    turned = run(chain, swap=swap, map=single, in_process=True)
    assert turned["last.w"].tolist() == EXPECTED[:, ::-1].tolist()
    assert simulated.provenance.maps == (("speed_out", "v"), ("w_out", "w"))


def test_a_campaign_fixes_it(chain, others, tmp_path):
    fixed = {"swap": {"to": str(others["other"])}, "map": ["speed_out=v", "w_out=w"]}
    given = {"system": str(chain), "fixed": fixed, "metrics": {"end": "last(last.w[3])"}}
    done = campaign(given, tmp_path / "out.zarr", workers=0)
    assert done.store.array("end").tolist() == [EXPECTED[-1, 2]]
    with pytest.raises(StructureError, match=r"fixed.map: must be a table, or a list"):
        campaign({**given, "fixed": {"map": 5}}, tmp_path / "other.zarr", workers=0)


def test_an_exported_system_retains_it(chain, others, tmp_path):
    names = {"speed_out": "v", "w_out": "w"}
    export(chain, tmp_path / "mine.ssp", swap={"to": others["other"]}, map=names)
    assert run(tmp_path / "mine.ssp", in_process=True)["last.w"].tolist() == EXPECTED.tolist()


def test_a_comparison_takes_each_name_for_the_fmus_that_have_it(chain, others, tmp_path):
    swap = [f"to={others['ours']},{others['other']}"]
    found = compare(chain, tmp_path / "out", swap=swap, map=["speed_out=v", "w_out=w"])
    assert not found.failures
    assert [r["last.w"].tolist() for r in found.results.values()] == [EXPECTED.tolist()] * 2
    with pytest.raises(UsageError, match=f"--map nothing: {NO_PORT}"):
        compare(chain, tmp_path / "out", swap=swap, map=["nothing=v"])


@pytest.mark.parametrize(
    ("names", "line"),
    [
        (
            ["speedo=v"],
            rf"--map speedo: {NO_PORT} \(close: speed_out\)",
        ),
        (["speed_out=vv"], "--map vv: the system has no such signal"),
        (
            ["speed_out=v[1]"],
            r"--map speed_out=v\[1\]: speed_out has 3 elements, v\[1\] has 1",
        ),
        (["speed_out=v", "speed_out[1]=v[1]"], r"speed_out\[1\] is given twice"),
        (["speed_out"], "--map speed_out: expected name=value"),
        (["speed_out=v", "speed_out=v"], "--map speed_out: is given twice"),
        (["to.speedo=v"], f"--map to.speedo: {NO_PORT}"),
    ],
)
def test_names_that_make_no_sense_are_reported(chain, others, names, line):
    with load(chain) as system, pytest.raises(UsageError, match=line):
        apply(system, swap={"to": others["other"]}, map=names)


def test_a_name_without_a_swap_is_reported(chain):
    with (
        load(chain) as system,
        pytest.raises(UsageError, match=NO_PORT),
    ):
        apply(system, map={"v": "v"})


def test_the_component_may_precede_the_name(chain, others):
    with load(chain) as system:
        names = {"to.speed_out": "v", "to.w_out": "w"}
        changed = apply(system, swap={"to": others["other"]}, map=names)
        assert not list(problems(changed, read_interfaces(changed)))


def test_a_wrong_unit_is_never_mapped_over(chain, others, fmus, tmp_path):
    odd = model("odd", "a[{}]", "b[{}]", "k[{}]")
    ports = [each._replace(unit="s") for each in odd.variables]
    path = build(Model("odd", ports, outputs=odd.outputs), tmp_path)
    with load(chain) as system, pytest.raises(StructureError) as caught:
        apply(system, swap={"to": path}, map={"a": "v", "b": "w"})
    assert "its output b is in s, last.v expects m" in str(caught.value)


# ---- the pieces


def variable(name, unit="m", text=""):
    return Variable(name, 0, "Real", "input", unit, text, True)


def vector(name, unit, text, size=3, form="{}[{}]", first=1):
    return [variable(form.format(name, i), unit, text) for i in range(first, first + size)]


def by_name(*groups):
    return {v.name: v for group in groups for v in group}


OURS = by_name(
    vector("r_TN_N", "m", "position of the target, N axes"),
    vector("r_SN_N", "m", "position of the servicer, N axes"),
    vector("rho_ref_N", "m", "reference position of the servicer relative to the target, N axes"),
    vector("v_SN_N", "m/s", "velocity of the servicer, N axes"),
    vector("F_cmd_S", "N", "commanded force, servicer axes"),
)


@pytest.mark.parametrize("form", ["{}[{}]", "{}_{}", "{}({})"])
@pytest.mark.parametrize("first", [0, 1])
def test_vectors_are_recognised_in_every_style(form, first):
    names = [form.format("r_TN_N", i) for i in range(first, first + 3)]
    found = by_style(names, OURS)
    assert [f.elements for f in families(names).values()] == [tuple(names)]
    if form == "{}[{}]" and first == 1:
        assert not found
    else:
        ((a, b),) = found.items()
        assert (a.elements, b.elements) == (tuple(names), ("r_TN_N[1]", "r_TN_N[2]", "r_TN_N[3]"))


def test_incomplete_vectors_are_not_grouped():
    names = ["a_1", "a_3", "b[2]", "b[3]", "c_0", "d", "e[1]", "e"]
    assert set(families(names)) >= {"a_1", "a_3", "b[2]", "b[3]", "d", "e"}
    assert by_style(["c_0"], ["c"]) == {}


NAMES = st.lists(
    st.from_regex(r"[ab](_[0-9]|\[[0-9]\]|\([0-9]\)|\[[0-9],[0-9]\])?", fullmatch=True)
)


@settings(max_examples=8 * settings().max_examples)
@given(theirs=NAMES, ours=NAMES, pair=st.tuples(st.text(max_size=6), st.text(max_size=6)))
def test_every_element_is_in_one_family_and_no_pair_is_taken_by_halves(theirs, ours, pair):
    groups = families(theirs)
    members = [element for family in groups.values() for element in family.elements]
    assert sorted(members) == sorted(set(theirs))
    for a, b in by_style(theirs, ours).items():
        assert len(a.elements) == len(b.elements) > 0
        assert set(a.elements) <= set(theirs)
        assert set(b.elements) <= set(ours)
    try:
        names = given_names([pair], theirs, ours)
        assert set(names) <= set(theirs)
        assert set(names.values()) <= set(ours)
    except ValueError as error:
        assert str(error)


@given(texts=st.lists(st.text(max_size=12), max_size=3))
def test_any_text_is_a_map_or_a_reason(texts):
    with load("space_robot") as system:
        try:
            apply(system, swap=["joints=joint_controller"], map=texts)
        except HarnessError as error:
            assert str(error)
