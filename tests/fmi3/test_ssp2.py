# SPDX-License-Identifier: BSD-2-Clause
"""SSP 2.0, written and read: the bits of SSP 1.0, arrays joined as a whole and element by element,
and what is rejected by name.
"""

from __future__ import annotations

import importlib.util
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from harness import run
from harness.authoring.export import export
from harness.cli import main
from harness.errors import StructureError, UsageError
from harness.files import paths
from harness.ssp.library import load
from harness.ssp.reader import opened
from harness.ssp.writer import write_ssp
from harness.ssp.xml import NS
from tests.fmi3 import odd
from tests.fmi3.odd import Model, Var
from tests.fmi3.test_master import SYSTEM, of_fmi_3, rows
from tests.harness.third_party_ssp import connection, write

VERSIONS = {"FMI 2": lambda i: False, "FMI 3": lambda i: True, "both": lambda i: i % 2 == 0}


@pytest.fixture(scope="module")
def violations():
    """violations(path): of the .ssd and .ssv of an .ssp, by the schemas of SSP 2.0 that a package
    brings.
    """
    package = importlib.util.find_spec("pyssp_standard")
    folder = Path(package.origin).parent / "resources/ssp2"
    names = {".ssd": "SystemStructureDescription", ".ssv": "SystemStructureParameterValues"}
    schemas = {end: etree.XMLSchema(file=str(folder / f"{n}.xsd")) for end, n in names.items()}

    def found(path):
        with zipfile.ZipFile(path) as archive:
            parts = [n for n in archive.namelist() if Path(n).suffix in schemas]
            for name in parts:
                schema = schemas[Path(name).suffix]
                schema.validate(etree.fromstring(archive.read(name)))
                yield from (f"{name}: {error.message}" for error in schema.error_log)

    return lambda path: list(found(path))


def read_again(system, path, version=None):
    write_ssp(system, path, version)
    with opened(path) as found:
        return found.connections, [c.parameters for c in found.components], found.sets


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_written_file_gives_the_system_and_its_bits(fmi, tmp_path, violations):
    path = tmp_path / "twin.ssp"
    with load(SYSTEM) as system:
        changed = of_fmi_3(system, VERSIONS[fmi])
        expected = system.connections, [c.parameters for c in system.components], system.sets
        assert read_again(changed, path, 2) == expected
        assert violations(path) == []
        bits = rows(system, stop=2.0)
    with opened(path) as twin:
        assert rows(twin, stop=2.0) == bits


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(paths.systems()))
def test_every_system_is_the_same_in_ssp_2(name, tmp_path, violations):
    with load(name) as system:
        for fmi, chosen in VERSIONS.items():
            read = read_again(of_fmi_3(system, chosen), tmp_path / f"{fmi}.ssp", 2)
            assert read == (
                system.connections, [c.parameters for c in system.components], system.sets
            ), fmi  # fmt: skip
            assert violations(tmp_path / f"{fmi}.ssp") == [], fmi


def test_the_first_version_that_can_hold_a_system_is_written(tmp_path):
    with load(SYSTEM) as system:
        write_ssp(system, tmp_path / "old.ssp")
        assert (tmp_path / "old.ssp").read_bytes() == paths.systems()[SYSTEM].read_bytes()
        mixed = of_fmi_3(system, VERSIONS["both"])
        export(mixed, tmp_path / "mixed.ssp")
        with pytest.raises(StructureError, match=r"guidance: is of FMI 3\.0, which needs SSP 2\.0"):
            export(mixed, tmp_path / "x.ssp", ssp=1)
        with pytest.raises(UsageError, match=r"--ssp applies only to \.ssp output"):
            export(system, tmp_path / "x.fmu", ssp=2)
        with pytest.raises(UsageError, match=r"--ssp: expected 1 or 2, got 3"):
            export(system, tmp_path / "x.ssp", ssp=3)
    with zipfile.ZipFile(tmp_path / "mixed.ssp") as archive:
        text = archive.read("SystemStructure.ssd").decode()
    assert 'version="2.0"' in text
    assert 'startConnector="r_TN_N[1]"' in text
    assert 'endConnector="r_TN_N" endIndices="1"' in text


def test_the_command_writes_it(tmp_path, capsys):
    path = tmp_path / "new.ssp"
    assert main(["export", SYSTEM, str(path), "--ssp", "2"]) == 0
    assert main(["check", str(path)]) == 0
    assert ": fine (" in capsys.readouterr().out


def test_omsimulator_reads_the_macro_step(tmp_path):
    annotation = "ssd:System/ssd:Annotations/ssc:Annotation[@type='org.openmodelica']"
    master = f"{annotation}/oms:Annotations/oms:SimulationInformation/oms:FixedStepMaster"
    found = {}
    for version in (1, 2):
        path = tmp_path / f"{version}.ssp"
        export(SYSTEM, path, ssp=version)
        with zipfile.ZipFile(path) as archive:
            text = archive.read("SystemStructure.ssd")
        found[version] = etree.fromstring(text).find(master, NS)
    assert found[1].attrib == found[2].attrib
    assert found[2].get("description") == "oms-ma"
    assert b"<oms:FixedStepMaster " in text  # it looks for the prefix, not for the namespace
    with load(SYSTEM) as system, opened(path) as again:
        assert float(found[2].get("stepSize")) == system.experiment.step
        assert again.experiment == system.experiment


# ---- arrays of third parties

SOURCE = Model(
    "source",
    (
        Var("n", "UInt64", "structuralParameter", "2"),
        Var("c", "Float64", "output"), Var("y", "Float64", "output", size=2, by="n"),
        Var("z", "Float64", "output", size=3),
    ),
    "c += 1; y[0] = c; y[1] = 10 * c;",
)  # fmt: skip
SINK = Model(
    "sink",
    (
        Var("n", "UInt64", "structuralParameter", "2"),
        Var("u", "Float64", "input", "0 0", 2, "n"), Var("x", "Float64", "input"),
        Var("gain", "Float64", "parameter", "1 1", 2), Var("s", "Float64", "output"),
    ),
    "s = gain[0] * u[0] + gain[1] * u[1] + 100 * x;",
)  # fmt: skip
ARRAY, SCALAR = '<c:Float64/><c:Dimension size="2"/>', "<c:Float64/>"


def connector(name, kind, inside):
    return f'<d:Connector name="{name}" kind="{kind}">{inside}</d:Connector>'


def component(name, connectors, bindings="", more=""):
    return (
        f'<d:Component name="{name}" source="resources/{name}.fmu" {more}>'
        f"<d:Connectors>{connectors}</d:Connectors>{bindings}</d:Component>"
    )


def bound(*parameters):
    """Bindings of parameters `name`, `type`, `value`, and XML after the value."""
    inside = "".join(
        f'<v:Parameter name="{n}"><v:{t} value="{x}"/>{more}</v:Parameter>'
        for n, t, x, more in parameters
    )
    return (
        "<d:ParameterBindings><d:ParameterBinding><d:ParameterValues>"
        f'<v:ParameterSet version="2.0" name="x"><v:Parameters>{inside}</v:Parameters>'
        "</v:ParameterSet></d:ParameterValues></d:ParameterBinding></d:ParameterBindings>"
    )


GAIN = ("gain", "Float64", "2 3", '<c:Dimension size="2"/>')
OUT = connector("y", "output", ARRAY) + connector("c", "output", SCALAR)
IN = connector("u", "input", ARRAY) + connector("x", "input", SCALAR)


def pair(*wires, source="", sink="", parameters=(GAIN,), more=""):
    parts = component("source", OUT + source, more=more) + component(
        "sink", IN + sink, bound(*parameters)
    )
    return system("top", parts, wires)


def system(name, parts, wires, connectors=""):
    lines = "".join(map(connection, wires))
    lines = f"<d:Connections>{lines}</d:Connections>" if lines else ""
    connectors = f"<d:Connectors>{connectors}</d:Connectors>" if connectors else ""
    inside = f"<d:Elements>{parts}</d:Elements>{lines}"
    return f'<d:System name="{name}">{connectors}{inside}</d:System>'


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    folder = tmp_path_factory.mktemp("arrays")
    return {model.name: odd.build(model, folder) for model in (SOURCE, SINK)}


@pytest.fixture
def simulate(built, tmp_path):
    """Pack and run a system, by both executors, which must agree to the bit."""

    def run_system(top, **options):
        path = write(tmp_path / "third_party.ssp", top, built, version="2.0", **options)
        result = run(path, in_process=True)
        again = run(path, executor="python", in_process=True)
        assert np.array_equal(result.values, again.values)
        return result

    return run_system


def seen(result):
    """Return the sum of the sink, in units of the source's count one step before."""
    assert result["source.c"][-1] == 3
    return (result["sink.s"][1:] / np.maximum(result["source.c"][:-1], 1)).tolist()


@pytest.mark.parametrize(
    ("wires", "factor"),
    [
        (["source.y sink.u"], 2 * 1 + 3 * 10),
        (["sink.u source.y"], 2 * 1 + 3 * 10),
        (['source.y sink.u startIndices="2" endIndices="1"'], 2 * 10),
        (['source.y sink.x startIndices="2"', 'source.c sink.u endIndices="2"'], 100 * 10 + 3),
    ],
)
def test_arrays_are_joined_as_a_whole_and_by_element(simulate, wires, factor):
    assert seen(simulate(pair(*wires))) == [0, factor, factor]


@pytest.mark.parametrize(
    "dimension",
    ['<c:Dimension size="2"/>', '<c:Dimension sizeConnector="m"/>', "<c:Dimension/>"],
)
def test_an_array_goes_through_a_system_of_its_own(simulate, dimension):
    ports = connector("v", "input", SCALAR + dimension)
    ports += connector("m", "structuralParameter", "<c:UInt64/>")
    size = bound(("m", "UInt64", "2", ""))
    inner = system("plant", component("sink", IN, bound(GAIN)), ["v sink.u"], ports)
    inner = inner.replace("</d:Connectors><d:Elements>", f"</d:Connectors>{size}<d:Elements>")
    result = simulate(system("top", component("source", OUT) + inner, ["source.y plant.v"]))
    summed, count = result["plant_sink.s"], result["source.c"]
    assert summed[1:].tolist() == (32 * count[:-1]).tolist()


def test_structural_parameters_are_read(simulate):
    stated = connector("n", "structuralParameter", "<c:UInt64/>")
    parameters = (GAIN, ("n", "UInt64", "2", ""))
    assert seen(simulate(pair("source.y sink.u", sink=stated, parameters=parameters)))[-1] == 32


def test_arrays_are_mapped_and_fill_the_schema_of_2_0(simulate, tmp_path, violations):
    other = bound(("k", "Float64", "2 3", '<c:Dimension size="2"/>'))
    mapping = (
        '<d:ParameterMapping><p:ParameterMapping version="2.0">'
        '<p:MappingEntry source="k" target="gain"/></p:ParameterMapping></d:ParameterMapping>'
    )
    other = other.replace("</d:ParameterValues>", f"</d:ParameterValues>{mapping}")
    top = pair("source.y sink.u").replace(bound(GAIN), other)
    assert seen(simulate(top))[-1] == 32
    assert violations(tmp_path / "third_party.ssp") == []
    with opened(tmp_path / "third_party.ssp") as found:
        write_ssp(found, tmp_path / "again.ssp")
        with opened(tmp_path / "again.ssp") as again:
            assert rows(again) == rows(found)
    assert violations(tmp_path / "again.ssp") == []


@pytest.mark.parametrize(
    ("top", "problem"),
    [
        (
            pair("source.z sink.u"),
            "source.z to sink.u: joins an array of 3 with an array of 2; select one element by "
            "startIndices or endIndices",
        ),
        (pair("source.y sink.x"), "source.y to sink.x: joins an array of 2 with a scalar"),
        (pair('source.y sink.u endIndices="3"'), "source.y to sink.u: there is no element u[3]"),
        (
            pair('source.y sink.u endIndices="1 1"'),
            "source.y to sink.u: there is no element u[1,1], the connector is an array of 2",
        ),
        (
            pair('source.c sink.x endIndices="1"'),
            "source.c to sink.x: there is no element x[1], the connector is a scalar",
        ),
        (
            pair("source.y sink.u", parameters=(("n", "UInt64", "5", ""),)),
            "sink.n: is a structuralParameter and cannot be set",
        ),
        (
            pair("source.y sink.u", parameters=(("gain", "Float64", "1 2 3", GAIN[3]),)),
            "component sink: parameter gain: has 3 values, expected 2",
        ),
        (
            pair("source.y sink.u", source=connector("tick", "output", "<c:Clock/>")),
            "SystemStructure.ssd, line 7: the Clock of tick is not supported",
        ),
        (
            pair("source.y sink.u", more='implementation="ScheduledExecution"'),
            "SystemStructure.ssd, line 7: Element",
        ),
        (
            pair("source.y sink.u").replace('source="resources/source.fmu"', ""),
            "component source: a file without a name is not in the archive",
        ),
        (
            pair("source.k sink.x", source=connector("k", "constant", SCALAR)),
            "source.k: there is no such output",
        ),
        (pair('source.y sink.u startIndices="0"'), "source.y to sink.u: startIndices='0'"),
        (
            pair("source.y sink.u", parameters=(("gain", "Float64", "1 a", GAIN[3]),)),
            "component sink: parameter gain: 'a' is not a value of type Real",
        ),
    ],
)  # fmt: skip
def test_unsupported_content_is_rejected_with_one_clear_line(simulate, top, problem):
    with pytest.raises(StructureError) as caught:
        simulate(top)
    assert caught.value.problems[0].removeprefix("third_party.ssp: ").startswith(problem)


def test_ssp_1_has_no_arrays(built, tmp_path):
    top = pair("source.y sink.u").replace("Float64", "Real")
    path = write(tmp_path / "third_party.ssp", top, built)
    with pytest.raises(StructureError, match="Dimension"):
        run(path)
