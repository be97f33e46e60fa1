# SPDX-License-Identifier: BSD-2-Clause
"""Changes by a user: parameter sets and files, single values, other FMUs."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest

from harness import load, run
from harness.errors import StructureError, UsageError
from harness.master.changes import apply
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.system.model import Parameter
from tests.harness.third_party_fmu import Model, build, p, u, y

pytestmark = pytest.mark.usefixtures("trusted")

TOML = """
name = "demo"
[experiment]
stop = 4.0
step = 1.0
[components]
first = "source"
second = "vector"
third = "gain"
[open]
"third.u" = 1.0
[parameters.second]
J = [[1, 0], [0, 1]]
[parameters.third]
k = 2
[sets.tripled]
[sets.tripled.third]
k = 3
[sets.tripled.experiment]
stop = 8.0
step = 2.0
"""


@pytest.fixture
def system(fmus):
    return system_of(tomllib.loads(TOML), fmus)


def value(system, name):
    component, _, variable = name.partition(".")
    return system.component(component).parameters[variable].value


def test_an_argument_that_does_not_exist_is_rejected(system):
    with pytest.raises(
        UsageError, match=r"^steps: there is no such change of a system \(close: step, stop\)$"
    ):
        apply(system, steps=3)
    with pytest.raises(UsageError, match=r"^realtime: there is no such change of a system$"):
        run(system, realtime=1.0)


# ---- parameters


def test_a_named_set_replaces_parameters_and_time_span(system):
    changed = apply(system, params="tripled")
    assert value(changed, "third.k") == 3.0
    assert (changed.experiment.stop, changed.experiment.step) == (8.0, 2.0)
    assert apply(system, params="default") == system


def test_options_win_over_the_set(system):
    changed = apply(
        system, params="tripled", stop=6.0, step=1.5, algorithm="jacobi", set=["third.k=5"]
    )
    assert (changed.experiment.stop, changed.experiment.step, changed.experiment.algorithm) == (
        6.0,
        1.5,
        "jacobi",
    )
    assert value(changed, "third.k") == 5.0


def test_single_values_are_numbers_vectors_matrices_or_elements(system):
    changed = apply(
        system, set=["second.J=[[1, 2], [3, 4]]", "second.J[1,2]=-7", "second.M.bias = 1e-3"]
    )
    assert [value(changed, f"second.J[{i},{j}]") for i in (1, 2) for j in (1, 2)] == [
        1.0,
        -7.0,
        3.0,
        4.0,
    ]
    assert value(changed, "second.M.bias") == 1e-3
    assert value(apply(system, set={"second.J[1,2]": 6}), "second.J[1,2]") == 6.0


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("third.kk=1", r"--set third\.kk: there is no such variable \(close: k\)"),
        ("thrd.k=1", r"--set thrd\.k: there is no component 'thrd' \(close: third\)"),
        ("k=1", r"--set k: expected component.variable, as in first\.k"),
        ("third.k", r"--set third\.k: expected name=value"),
        ("third.k=nan", r"--set third\.k: it must not be NaN"),
        ("third.k=fast", r"--set third\.k: 'fast' is not a number"),
        (
            "second.J=[1, 2]",
            r"--set second\.J: expected 2 x 2 elements, got 2 elements; the FMU fixes the number "
            "of elements",
        ),
    ],
)
def test_a_mistaken_single_value_is_wrong_use(system, text, problem):
    with pytest.raises(UsageError, match=f"^{problem}$"):
        apply(system, set=[text])


def test_all_mistaken_values_come_at_once(system):
    with pytest.raises(UsageError) as caught:
        apply(system, set=["third.kk=1", "thrd.k=1", "third.k=nan"])
    assert len(str(caught.value).splitlines()) == 3


@pytest.mark.parametrize("head", ["", "parameters."])
def test_a_toml_file_of_parameters_overrides_what_it_names(system, tmp_path, head):
    path = tmp_path / "x.toml"
    path.write_text(f"[{head}shared]\nk = 9\n[{head}second]\nM.bias = 0.5\n")
    changed = apply(system, params=path)
    assert (
        value(changed, "third.k"),
        value(changed, "second.M.bias"),
        value(changed, "second.J[1,1]"),
    ) == (9, 0.5, 1)


SSV = """<v:ParameterSet version="1.0" name="x" xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
<v:Parameters><v:Parameter name="{name}"><v:Real
value="{value}"{unit}/></v:Parameter></v:Parameters> </v:ParameterSet>"""


def test_an_ssv_file_of_parameters_overrides_what_it_names(system, tmp_path):
    path = tmp_path / "x.ssv"
    path.write_text(SSV.format(name="third.k", value=11, unit=""))
    assert run(apply(system, params=str(path)))["third.y"].tolist() == [11.0] * 5


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        (
            "x.toml",
            "[third]\nkk = 1\n",
            r"x\.toml: third\.kk: there is no such variable \(close: k\)",
        ),
        (
            "x.toml",
            "[thrd]\nk = 1\n",
            r"x\.toml: thrd: expected a table per component, and no component has this name",
        ),
        ("x.toml", "k = 1\n", r"x\.toml: k: expected a table per component"),
        ("x.toml", "third = 1\n", r"x\.toml: third: expected a table per component(?!, and no)"),
        ("x.toml", "[third\n", "not a readable TOML file"),
        ("x.toml", "parameters = 3\n", "x.toml: parameters: must be a table of tables, one per"),
        (
            "x.ssv",
            SSV.format(name="thrd.k", value=1, unit=""),
            r"x\.ssv: thrd\.k: there is no component 'thrd'",
        ),
        (
            "x.ssv",
            SSV.format(name="third.kk", value=1, unit=""),
            r"third\.kk: there is no such parameter \(close: k\)",
        ),
        (
            "x.ssv",
            SSV.format(name="third.k", value=1, unit=' unit="m"'),
            r"third\.k: is given in m, but its unit is 1",
        ),
        (
            "x.ssv",
            SSV.format(name="third.k", value="NaN", unit=""),
            r"parameter third\.k: must not be NaN",
        ),
        ("x.ssv", "<a/>", r"x\.ssv, line 1: Element 'a'"),
        ("x.ssv", "<a", "not a readable XML file"),
    ],
)
def test_a_mistaken_file_of_parameters_is_rejected(system, tmp_path, name, text, problem):
    (tmp_path / name).write_text(text)
    with pytest.raises(StructureError, match=problem):
        run(system, params=tmp_path / name)


def test_an_unknown_set_or_file_is_wrong_use(system):
    with pytest.raises(
        UsageError, match=r"--params triple: demo has no such parameter set \(close: tripled\)"
    ):
        apply(system, params="triple")
    with pytest.raises(
        UsageError, match=r"--params q: demo has no such parameter set, only default, tripled"
    ):
        apply(system, params="q")
    with pytest.raises(UsageError, match=r"--params gone\.toml: no such file"):
        apply(system, params="gone.toml")


# ---- latency


def test_a_latency_delays_what_a_component_publishes(make):
    system = make({"count": "counter", "twice": "gain"}, ["count.n > twice.u"], stop=4.0)
    assert run(system)["twice.y"].tolist() == [0, 2, 4, 6, 8]
    assert run(system, latency=["count=1"])["twice.y"].tolist() == [0, 0, 2, 4, 6]
    assert run(system, latency={"count": 1})["twice.y"].tolist() == [0, 0, 2, 4, 6]


@pytest.mark.parametrize(
    ("text", "error", "problem"),
    [
        ("secnd=1", UsageError, r"--latency secnd: demo has no such component \(close: second\)"),
        ("second=soon", UsageError, "--latency second: expected a number of macro steps, got soon"),
        ("second=-1", StructureError, r"second: latency must lie in 0\.\.1 macro steps"),
        ("second=2", StructureError, r"second: latency must lie in 0\.\.1 macro steps"),
    ],
)
def test_a_mistaken_latency_is_rejected(system, text, error, problem):
    with pytest.raises(error, match=problem):
        run(system, latency=[text])


# ---- another FMU


OTHER = Model(
    "other",
    [
        *(u(f"v[{i}]", "m") for i in (1, 2, 3)),
        u("y"),
        *(y(f"w[{i}]", "m") for i in (1, 2, 3)),
        p("M.bias", 1.0),
        p("new"),
    ],
    "w_1 = v_1 + y; w_2 = v_2; w_3 = new;",
)


@pytest.fixture
def other(tmp_path):
    """Replacement for `vector`: the same output from other inputs."""
    return build(OTHER, tmp_path)


def test_a_swapped_fmu_takes_over_the_wiring_and_finds_further_inputs_by_name(
    system, other, caplog
):
    result = run(system, swap=[f"second={other}"], set=["second.new=42"])
    assert result["second.w"][-1].tolist() == [
        4 + 2,
        40,
        42,
    ]  # v[1] of `first` + y of `third`, v[2], new
    assert caplog.messages == ["second: other.fmu does not have these parameters of vector: J"]


def test_dropped_parameters_leave_the_named_sets_too(system, other):
    changed = apply(system, swap={"second": other})
    assert "J[1,1]" not in changed.sets[0].parameters["second"]
    assert run(apply(system, params="tripled", swap={"second": other})).complete


@pytest.mark.usefixtures("project_fmus")
def test_a_swapped_fmu_by_name_comes_from_the_project(system):
    assert run(system, swap=["third=plus_one"])["third.y"].tolist() == [2.0] * 5


def test_missing_ports_and_units_of_a_swapped_fmu_come_all_at_once(make, tmp_path):
    system = make({"c": "counter", "g": "gain", "v": "gain"}, ["c.n > g.u", "c.t_last > v.u"])
    clock = build(Model("clock", [u("u", "s"), y("y", "s")], outputs="y = u;"), tmp_path)
    c, g, v = system.components
    system = replace(system, components=(c, g, replace(v, fmu=clock)), strict=True)
    odd = build(Model("odd", [y("t_last", "m"), u("lost")]), tmp_path)
    with pytest.raises(StructureError) as caught:
        apply(system, swap=[f"c={odd}"])
    assert list(caught.value.problems) == [
        "--swap c=odd.fmu: its input lost: no output of this name drives it",
        "--swap c=odd.fmu: it has no output n, which g.u needs",
        "--swap c=odd.fmu: its output t_last is in m, v.u expects s",
        "--swap c=odd.fmu: its ports lost match no signal; connect each by --map PORT=SIGNAL",
    ]


def test_an_ambiguous_input_of_a_swapped_fmu_names_the_candidates(make, tmp_path):
    system = replace(
        make({"a": "gain", "b": "gain", "c": "counter"}, parameters={"a.u": 1.0, "b.u": 1.0}),
        strict=True,
    )
    reader = build(Model("reader", [u("y"), y("n")]), tmp_path)
    with pytest.raises(StructureError, match="its input y: ambiguous, a and b have an output"):
        apply(system, swap=[f"c={reader}"])


ALTERNATIVE = """
[alternatives.other]
replaces = "second"
[alternatives.other.second]
new = 42
[alternatives.other.third]
k = 5
"""


@pytest.fixture
def prepared(fmus, other):
    """The system knows with which parameters `other` runs."""
    return system_of(tomllib.loads(TOML + ALTERNATIVE), fmus | {"other": other})


def test_an_fmu_that_the_system_knows_runs_with_the_parameters_meant_for_it(
    prepared, other, caplog
):
    changed = apply(prepared, swap={"second": other})
    assert (value(changed, "second.new"), value(changed, "third.k")) == (42, 5)
    assert run(changed)["second.w"][-1].tolist() == [4 + 5, 40, 42]
    assert caplog.messages == []
    assert value(prepared, "third.k") == 2


def test_parameters_for_an_alternative_override_a_named_set_and_single_values_over_them(
    prepared, other
):
    assert value(apply(prepared, params="tripled", swap={"second": other}), "third.k") == 5
    assert apply(prepared, swap={"second": other}).sets[0].parameters["third"]["k"].value == 5
    assert value(apply(prepared, swap={"second": other}, set=["third.k=7"]), "third.k") == 7


def test_an_fmu_of_another_name_gets_nothing(prepared, other, tmp_path, caplog):
    stranger = build(Model("stranger", OTHER.variables, OTHER.outputs), tmp_path)
    changed = apply(prepared, swap={"second": stranger})
    assert value(changed, "third.k") == 2
    assert "new" not in changed.component("second").parameters
    assert len(caplog.messages) == 1


def test_alternatives_survive_in_the_ssp(prepared, other, tmp_path):
    write_ssp(prepared, tmp_path / "demo.ssp")
    with load(tmp_path / "demo.ssp") as back:
        assert [(a.component, a.fmu) for a in back.alternatives] == [("second", "other")]
        assert value(apply(back, swap={"second": other}), "third.k") == 5


def test_an_exchanged_component_has_no_alternatives_any_more(prepared, other):
    assert apply(prepared, swap={"second": other}).alternatives == ()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            '[alternatives.othr]\nreplaces = "second"',
            r"alternatives\.othr: there is no FMU othr \(close: other\)",
        ),
        (
            '[alternatives.other]\nreplaces = "secnd"',
            r"--swap secnd: demo has no such component \(close: second\)",
        ),
        (
            "[alternatives.other]\n",
            r"alternatives\.other\.replaces: is missing",
        ),
        (
            '[alternatives.gain]\nreplaces = "first"',
            r"gain\.fmu: it has no output v, which second\.v needs",
        ),
        (ALTERNATIVE + "z = 1", r"alternatives\.other: third\.z: there is no such variable"),
        (
            '[alternatives.other]\nreplaces = "second"\nnew = 3',
            r"new: expected a table per component",
        ),
    ],
)
def test_a_mistaken_alternative_is_rejected_when_the_system_is_built(fmus, other, text, problem):
    with pytest.raises(StructureError, match=problem):
        system_of(tomllib.loads(TOML + text), fmus | {"other": other})


def test_a_warning_of_dropped_parameters_stays_short(make, fmus, caplog):
    system = make(
        {"a": "vector"},
        parameters={f"a.J[{i},{j}]": 1.0 for i in (1, 2) for j in (1, 2)} | {"a.M.bias": 1},
    )
    parameters = {f"p{i}": Parameter(1.0) for i in range(9)}
    system = replace(system, components=(replace(system.components[0], parameters=parameters),))
    apply(system, swap={"a": fmus["gain"]})
    assert caplog.messages == [
        "a: gain.fmu does not have these parameters of vector: p0, p1, p2, p3, p4 and 4 more"
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("secnd=x.fmu", r"--swap secnd: demo has no such component \(close: second\)"),
        ("second=no_such_fmu", "no_such_fmu: there is no such FMU"),
        ("second", "--swap second: expected name=value"),
    ],
)
def test_a_mistaken_swap_is_wrong_use(system, text, problem):
    with pytest.raises(UsageError, match=problem):
        apply(system, swap=[text])


def test_the_system_itself_is_never_changed(system):
    before = replace(system)
    apply(system, params="tripled", set=["third.k=7"], stop=2.0)
    assert system == before
    assert system.component("third").parameters["k"] == Parameter(2.0, "1")


def test_a_shared_value_is_set_wherever_it_is_known(tmp_path):
    """As [shared] of a parameter set; what is given for one component wins, in any order."""
    given = ["servicer.J2=0", "shared.J2=1e-3"]
    with load("sync_approach") as system:
        changed = apply(system, set=given)
        before = {c.name: "J2" in c.parameters for c in system.components}
        values = {
            c.name: c.parameters["J2"].value for c in changed.components if "J2" in c.parameters
        }
    assert {name for name, known in before.items() if known} == set(values)
    assert values.pop("servicer") == 0
    assert values == {"target": 1e-3, "monitor": 1e-3}


def test_an_unknown_shared_value_is_rejected():
    with (
        load("sync_approach") as system,
        pytest.raises(UsageError, match=r"--set shared\.incl: no"),
    ):
        apply(system, set=["shared.incl=1.6"])
