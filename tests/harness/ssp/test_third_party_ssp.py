# SPDX-License-Identifier: BSD-2-Clause
"""Systems written by other tools: bindings, mappings, nested systems, units and transformations of
signals.
"""

from __future__ import annotations

import logging
import math

import numpy as np
import pytest

from harness import run
from harness.cli.app import main
from harness.errors import StructureError
from harness.ssp import reader as ssp
from tests.harness.third_party_ssp import component, inline, linear, ssm, ssv, system, write

pytestmark = pytest.mark.usefixtures("trusted")

COUNT = component("count", "counter", "n>", "t_last>")
GAIN = component("gain", "gain", "u<", "y>", "k=")


@pytest.fixture
def simulate_case(fmus, tmp_path):
    """Pack and run a system, by both executors, which must agree to the bit."""

    def run_system(top, files=None, **options):
        path = write(tmp_path / "third_party.ssp", top, fmus, files, **options)
        result = run(path)
        assert np.array_equal(result.values, run(path, executor="python").values)
        return result

    return run_system


@pytest.fixture
def complaints(fmus, tmp_path):
    def complaints_of(top, files=None, **options):
        path = write(tmp_path / "third_party.ssp", top, fmus, files, **options)
        with pytest.raises(StructureError) as caught:
            run(path)
        return [p.removeprefix("third_party.ssp: ") for p in caught.value.problems]

    return complaints_of


TABLE = (
    '<c:IntegerMappingTransformation><c:MapEntry source="1" target="2"/>'
    "</c:IntegerMappingTransformation>"
)


def pair(wire="count.n gain.u", bindings=""):
    return system("top", [COUNT, component("gain", "gain", "u<", "y>", bindings=bindings)], [wire])


# ---- parameter bindings


def binding(attributes, inside=""):
    return f"<d:ParameterBinding {attributes}>{inside}</d:ParameterBinding>"


def test_external_and_inline_sets_later_ones_win(simulate_case):
    files = {"resources/a b.ssv": ssv("k=5", namespaces=True)}
    external = binding('source="resources/a%20b.ssv"')
    assert simulate_case(pair(bindings=external), files)["gain.y"].tolist() == [0, 0, 5, 10]
    assert simulate_case(pair(bindings=external + inline(ssv("k=7"))), files)[
        "gain.y"
    ].tolist() == [
        0,
        0,
        7,
        14,
    ]
    assert simulate_case(pair(bindings=inline(ssv("k=7")) + external), files)[
        "gain.y"
    ].tolist() == [
        0,
        0,
        5,
        10,
    ]


def test_a_parameter_that_is_given_twice_in_one_set_is_rejected(simulate_case):
    with pytest.raises(StructureError, match="parameter k: is given twice"):
        simulate_case(pair(bindings=inline(ssv("k=5", "k=7"))))


def test_a_binding_of_the_system_wins_over_a_component_and_takes_dotted_names_and_prefixes(
    simulate_case,
):
    gain = component("gain", "gain", bindings=inline(ssv("k=5")))
    for outer in (inline(ssv("gain.k=8")), inline(ssv("k=8"), prefix="gain.")):
        top = system("top", [COUNT, gain], ["count.n gain.u"], bindings=outer)
        assert simulate_case(top)["gain.y"].tolist() == [0, 0, 8, 16]


def test_a_parameter_in_another_unit_is_converted(simulate_case, complaints):
    top = system("top", [component("far", "kilometres", bindings=inline(ssv("k=1500 m")))], [])
    assert simulate_case(top)["far.y"].tolist() == [1.5] * 4
    top = top.replace('unit="m"', 'unit="s"')
    assert complaints(top) == [
        "far.k: is given in s, but its unit is km (s [s] cannot be converted to km [m])"
    ]


def test_an_enumeration_is_given_by_the_name_of_its_item(simulate_case, complaints):
    top = system("top", [component("a", "moded", bindings=inline(ssv("mode=go!")))], [])
    assert simulate_case(top)["a.y"].tolist() == [70] * 4
    assert complaints(top.replace('"go"', '"gone"')) == [
        "a.mode: the enumeration has no item 'gone' (close: go), only off, hold, go"
    ]


def test_a_name_that_nothing_has_is_ignored_as_ssp_requires_it_and_the_log_states_so(
    simulate_case, caplog
):
    top = system(
        "top",
        [COUNT, GAIN],
        ["count.n gain.u"],
        bindings=inline(ssv("gain.kk=1", "nobody.k=2", "gain.k=3")),
    )
    with caplog.at_level(logging.WARNING):
        assert simulate_case(top)["gain.y"].tolist() == [0, 0, 3, 6]
    assert "gain.kk: ignored, gain.fmu has no such parameter" in caplog.messages
    assert (
        "nobody.k: no element or connector of the system has this name, ignored" in caplog.messages
    )


# ---- parameter mappings


def test_a_mapping_renames_and_transforms_after_the_prefix(simulate_case, caplog):
    mapping = ssm(f"X.amp k {linear(2, 1)}")
    top = pair(bindings=inline(ssv("amp=3", "other=1"), mapping, prefix="X."))
    with caplog.at_level(logging.WARNING):
        assert simulate_case(top)["gain.y"].tolist() == [0, 0, 7, 14]
    assert "parameters that their mapping does not mention are not set: X.other" in caplog.messages


def test_an_external_mapping_of_the_system_converts_units_before_it_transforms(simulate_case):
    files = {"m.ssm": ssm(f"length far.k {linear(2, 0.5)}", namespaces=True)}
    with_file = inline(ssv("length=1500 m")).replace(
        "</d:ParameterBinding>", '<d:ParameterMapping source="m.ssm"/></d:ParameterBinding>'
    )
    assert (
        simulate_case(
            system("top", [component("far", "kilometres")], [], bindings=with_file), files
        )["far.y"][0]
        == 3.5
    )
    files["m.ssm"] = files["m.ssm"].replace(
        "<p:MappingEntry", '<p:MappingEntry suppressUnitConversion="true"'
    )
    suppressed = simulate_case(
        system("top", [component("far", "kilometres")], [], bindings=with_file), files
    )
    assert suppressed["far.y"][0] == 3000.5


def test_a_table_of_items_is_rejected(complaints):
    entry = '<c:MapEntry source="slow" target="hold"/>'
    mapping = ssm(
        f"a mode <c:EnumerationMappingTransformation>{entry}</c:EnumerationMappingTransformation>"
    )
    top = system("top", [component("m", "moded", bindings=inline(ssv("a=slow!"), mapping))], [])
    (problem,) = complaints(top)
    assert problem.endswith(": the EnumerationMappingTransformation of m is not supported")


# ---- nested systems


def nested():
    tank = system(
        "tank",
        [component("gain", "gain", "u<", "y>", "k="), component("store", "integrator", "u<", "y>")],
        ["level_in gain.u", "gain.y store.u", "store.y level", "rate gain.k"],
        "level_in<", "level>", "rate=",
    )  # fmt: skip
    plant = system("plant", [tank], ["feed tank.level_in", "tank.level out"], "feed<", "out>")
    return [COUNT, plant, component("last", "plus_one", "u<", "y>")], [
        "count.n plant.feed",
        "plant.out last.u",
    ]


START = inline(ssv("count.n_0=1"))


FLAT = [
    COUNT,
    component("plant_tank_gain", "gain"),
    component("plant_tank_store", "integrator"),
    component("last", "plus_one"),
]
FLAT_WIRES = [
    "count.n plant_tank_gain.u",
    "plant_tank_gain.y plant_tank_store.u",
    "plant_tank_store.y last.u",
]


def test_nested_systems_are_the_flat_system_under_joined_names(simulate_case):
    result = simulate_case(system("top", *nested(), bindings=START))
    flat = simulate_case(system("top", FLAT, FLAT_WIRES, bindings=START))
    assert result.columns == flat.columns
    assert np.array_equal(result.values, flat.values)
    assert result["last.y"].tolist() != [1, 1, 1, 1]


def test_connections_may_be_written_from_the_input_to_the_output(simulate_case):
    elements, wires = nested()
    turned = [" ".join(reversed(wire.split(" "))) for wire in wires]
    straight = simulate_case(system("top", elements, wires, bindings=START))
    assert np.array_equal(
        simulate_case(system("top", elements, turned, bindings=START)).values, straight.values
    )


def test_parameters_of_nested_systems_by_connector_and_by_dotted_name(simulate_case):
    flat = simulate_case(
        system("top", FLAT, FLAT_WIRES, bindings=START + inline(ssv("plant_tank_gain.k=5")))
    )
    for name in ("plant.tank.gain.k", "plant.tank.rate"):
        result = simulate_case(system("top", *nested(), bindings=START + inline(ssv(f"{name}=5"))))
        assert np.array_equal(result.values, flat.values)


@pytest.mark.parametrize(
    ("inner", "outer", "k"),
    [
        ("rate=5", "plant.rate=9", 9),
        ("rate=5", "plant.gain.k=8", 8),
        ("rate=5", "", 5),
        ("gain.k=7", "plant.rate=9", 9),
    ],
)
def test_the_outer_binding_wins_by_connector_and_by_name(simulate_case, inner, outer, k):
    gain = component("gain", "gain", bindings=inline(ssv("k=3")))
    ports, wires = ("u<", "rate="), ["u gain.u", "rate gain.k"]
    plant = system("plant", [gain], wires, *ports, bindings=inline(ssv(inner)))
    over = inline(ssv(outer)) if outer else ""
    result = simulate_case(system("top", [COUNT, plant], ["count.n plant.u"], bindings=over))
    assert result["plant_gain.y"].tolist() == [0, 0, k, 2 * k]


def test_inputs_of_the_top_system_take_their_value_from_its_bindings(simulate_case):
    wires = [f"u gain.u {linear(2, 1)}", "gain.y y"]
    top = system("top", [GAIN], wires, "u<", "y>", bindings=inline(ssv("u=3")))
    assert simulate_case(top)["gain.y"].tolist() == [14] * 4
    unused = system("top", [GAIN], wires, "u<", "y>")
    assert simulate_case(unused)["gain.y"].tolist() == [0] * 4


def test_a_value_for_an_input_of_the_top_system_is_in_the_unit_of_its_connector(simulate_case):
    top = system(
        "top", [component("far", "kilometres")], ["u far.u"], "u< m", bindings=inline(ssv("u=2000"))
    )
    assert simulate_case(top)["far.y"][0] == 3
    assert simulate_case(top.replace('value="2000"', 'value="500000" unit="cm"'))["far.y"][0] == 6


def test_as_many_components_as_allowed_are_read(fmus, tmp_path, monkeypatch):
    inner = system("inner", [component("c", "gain")], [])
    path = write(tmp_path / "x.ssp", system("top", [inner, component("d", "gain")], []), fmus)
    monkeypatch.setattr(ssp, "MAX_COMPONENTS", 1)
    stated = "the system has 2 components, more than the limit of 1"
    with pytest.raises(StructureError, match=stated), ssp.opened(path):
        pass
    monkeypatch.setattr(ssp, "MAX_COMPONENTS", 2)
    with ssp.opened(path) as found:
        assert len(found.components) == 2


def test_names_are_unique_c_identifiers(fmus, tmp_path, caplog):
    elements = [
        component("a_b", "gain"),
        system("a", [component("b", "gain")], []),
        component("1 st", "gain"),
        component("überflug", "gain"),
    ]
    path = write(tmp_path / "x.ssp", system("top", elements, []), fmus)
    with caplog.at_level(logging.WARNING), ssp.opened(path) as found:
        assert [c.name for c in found.components] == ["a_b", "a_b_2", "_1_st", "_berflug"]
    assert caplog.messages == [
        "components renamed, since names must be unique identifiers: "
        "a.b as a_b_2, 1 st as _1_st, überflug as _berflug"
    ]


def test_connectors_of_systems_that_drive_each_other_are_rejected(complaints):
    inner = system("inner", [GAIN], ["u y", "u gain.u"], "u<", "y>")
    assert complaints(system("top", [inner], ["inner.y inner.u"])) == [
        "inner.u to inner.gain.u: has more than 200 connections on its way, perhaps in a loop"
    ]


# ---- signals


@pytest.mark.parametrize(
    ("attribute", "factor", "offset"), [("", 0.1, 5.0), ('suppressUnitConversion="1" ', -3.0, 0.0)]
)
def test_a_linear_transformation_of_a_signal(simulate_case, attribute, factor, offset):
    result = simulate_case(pair(f"count.n gain.u {attribute}{linear(factor, offset)}"))
    assert (
        result["gain.y"][1:].tolist() == (2.0 * (factor * result["count.n"][:-1] + offset)).tolist()
    )


def test_units_of_signals_are_converted(simulate_case):
    top = system(
        "top", [component("s", "source"), component("far", "kilometres")], ["s.v[2] far.u"]
    )
    result = simulate_case(top)
    assert result["far.y"][1:].tolist() == [1 + v / 1000 for v in result["s.v[2]"][:-1]]
    reused = system(
        "top",
        [component("c", "celsius"), component("k", "kelvin")],
        ["c.y k.u"],
        bindings=inline(ssv("c.u=20")),
    )
    assert simulate_case(reused)["k.y"].tolist() == [293.15] * 4
    cold = system(
        "top",
        [component("c", "celsius"), component("k", "kelvin")],
        ["k.y c.u"],
        bindings=inline(ssv("k.u=0")),
    )
    assert simulate_case(cold)["c.y"].tolist() == [-273.15] * 4


def test_units_convert_back_and_forth_through_connectors_of_systems(simulate_case):
    """From m to cm, times 2 plus 50 cm, suppressed conversion (cm taken as km), minus 1."""
    inner = system(
        "inner",
        [component("far", "kilometres")],
        [f'u far.u suppressUnitConversion="true" {linear(1, -1)}'],
        "u< cm",
    )
    top = system("top", [component("s", "source"), inner], [f"s.v[1] inner.u {linear(2, 50)}"])
    result = simulate_case(top)
    assert result["inner_far.y"][1:].tolist() == [
        1 + (200 * v + 50 - 1) for v in result["s.v[1]"][:-1]
    ]


@pytest.mark.parametrize(
    ("top", "problem"),
    [
        (
            system("top", [COUNT, component("far", "kilometres")], ["count.t_last far.u"]),
            "far.u: expected unit km, count.t_last has s (s [s] cannot be converted to km [m])",
        ),
        (
            system(
                "top", [component("m", "mixed"), component("n", "mixed")], [f"m.n n.i {linear(2)}"]
            ),
            "n.i: has type Integer, but only the type Real can be scaled or converted",
        ),
        (
            pair(f"count.n gain.u {linear(math.inf)}".replace("inf", "INF")),
            "count.n to gain.u: factor and offset of its transformation must be finite",
        ),
        (
            pair(f"count.n gain.u {TABLE}"),
            "SystemStructure.ssd, line 7: the IntegerMappingTransformation of top is not supported",
        ),
        (pair("count.n gian.u"), "count.n to gian.u: there is no component 'gian' (close: gain)"),
        (
            system("top", [COUNT, GAIN], ["count.n gain.u", "count.t_last count.n"]),
            "count.t_last to count.n: connects two ends that give a signal",
        ),
        (
            system("top", [COUNT, GAIN], ["count.n y"]),
            "count.n to y: the system has no connector y",
        ),
        (
            system(
                "top", [component("a", "gain", "k~"), component("b", "gain", "k=")], ["a.k b.k"]
            ),
            "a.k: is connected as output, but its causality is parameter",
        ),
        (
            system("top", [component("far", "kilometres", "u< m")], []),
            "far.u: the unit is m in the file, but km in the FMU",
        ),
        (
            system("top", [GAIN], ["gain.y y"], "y>", bindings=inline(ssv("y=1"))),
            "y: start values of outputs of a system are not supported",
        ),
        (
            pair(bindings=binding('source="http://x.org/a.ssv"')),
            "component gain: http://x.org/a.ssv is outside of the archive and is not read",
        ),
        (
            pair(bindings=binding('source="a.csv" type="text/csv"')),
            "component gain: text/csv cannot be read, only application/x-ssp-parameter-set",
        ),
        (
            pair(bindings=binding('source="a.ssv" sourceBase="component"')),
            "component gain: a.ssv: a file inside an FMU is not supported",
        ),
        (pair(bindings=inline("<v:ParameterSet/>")), "component gain: ParameterSet, line"),
    ],
)
def test_unsupported_content_is_rejected_with_one_clear_line(complaints, top, problem):
    assert complaints(top)[0].startswith(problem)


# ---- versions and time


def test_a_file_of_ssp_2_is_read_and_evaluated(simulate_case, complaints):
    top = pair(bindings=inline(ssv("k=3", version="2.0").replace("v:Real", "v:Float64")))
    output = '<d:Connector name="y" kind="output"><c:Float64/></d:Connector>'
    top = top.replace("<d:Elements>", f"<d:Connectors>{output}</d:Connectors><d:Elements>", 1)
    top = top.replace(
        '<d:System name="top">', '<d:System name="top"><c:MetaData kind="general"/>', 1
    )
    assert simulate_case(top, version="2.0")["gain.y"].tolist() == [0, 0, 3, 6]
    assert (
        "'signal'" in complaints(top.replace('kind="output"', 'kind="signal"', 1), version="2.0")[0]
    )


def test_without_an_experiment_step_and_stop_are_requested_in_one_line(
    fmus, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    path = str(write(tmp_path / "third_party.ssp", pair(), fmus, experiment=""))
    assert main(["run", path]) == 1
    assert capsys.readouterr().err == (
        "harness: the system defines neither macro step nor stop time: "
        "set both with --step, --stop\n"
    )
    assert main(["run", path, "--step", "1", "--stop", "2", "-o", "x.csv"]) == 0
    assert main(["check", path]) == 0
    assert capsys.readouterr().out.endswith(
        "third_party: fine (2 components, 1 connections, 1 parameter sets), "
        "give --step and --stop\n"
    )
    assert main(["list", path]) == 0
    assert "components  count (counter), gain (gain)" in capsys.readouterr().out
