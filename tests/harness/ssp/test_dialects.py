# SPDX-License-Identifier: BSD-2-Clause
"""Small systems in the dialects of other tools, each with numbers worked out by hand, and what the
log reports where a file deviates from the standard.

The systems count steps (`count.n` = 0, 1, 2, 3) and multiply: under Jacobi, the order of a file
that names none, a gain shows the count of one step before.
"""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from harness import run
from harness.cli.app import main
from harness.errors import FmuError, StructureError
from tests.harness.third_party_fmu import GAIN as GAIN_MODEL
from tests.harness.third_party_fmu import KILOMETRES, description
from tests.harness.third_party_ssp import component, inline, linear, ssm, ssv, system, write

pytestmark = pytest.mark.usefixtures("trusted")

COUNT = component("count", "counter", "n>", "t_last>")
GAIN = component("gain", "gain", "u<", "y>", "k=")
WIRE = ["count.n gain.u"]
TWICE = [0, 0, 2, 4]


def bound(attributes, inside="", owner="gain"):
    """A gain whose binding is written by hand."""
    text = f"<d:ParameterBinding {attributes}>{inside}</d:ParameterBinding>"
    return component(owner, "gain", "u<", "y>", "k=", bindings=text)


def top(gain=GAIN, wires=WIRE, *ports, count=COUNT, **further):
    return system("top", [count, gain], wires, *ports, **further)


VALUES = "<d:ParameterValues>{}</d:ParameterValues>"
SET, MAP = {"k.ssv": ssv("k=5", namespaces=True)}, {"k.ssm": ssm("gain k", namespaces=True)}
OUTER = {"k.ssv": ssv("gain=5", namespaces=True)} | MAP
GIVEN = VALUES.format(ssv("k=5"))

DIALECTS = {
    "OMSimulator: empty elements of own connectors": (
        top(GAIN, ["count.n gain.u", "gain.y y"], "y>").replace(
            'endConnector="y"', 'endElement="" endConnector="y"'
        ),
        {}, TWICE, (),
    ),
    "OMSimulator: the system drives its components": (
        top(GAIN, ["count.n gain.u"], "k=", bindings=inline(ssv("k=3"))).replace(
            "</d:Connections>",
            '<d:Connection startElement="" startConnector="k" endElement="gain" endConnector="k"/>'
            "</d:Connections>",
        ),
        {}, [0, 0, 3, 6], (),
    ),
    "OMSimulator: one file of parameters for the system": (
        top(bindings='<d:ParameterBinding source="k.ssv"/>'),
        {"k.ssv": ssv("gain.k=5", namespaces=True)}, [0, 0, 5, 10], (),
    ),
    "OMSimulator: empty prefix, empty type, empty base": (
        top(bound('prefix="" type="" source="k.ssv" sourceBase=""')), SET, [0, 0, 5, 10], (),
    ),
    "an empty source beside values": (
        top(bound('source=""', GIVEN)), {}, [0, 0, 5, 10], (),
    ),
    "a mapping of nothing": (
        top(bound("", GIVEN + '<d:ParameterMapping source=""/>')),
        {}, [0, 0, 5, 10], ("component gain: a ParameterMapping is empty",),
    ),
    "a binding of nothing": (
        top(bound('source=""')), {}, TWICE, ("component gain: a ParameterBinding is empty",),
    ),
    "a mapping in a file of its own": (
        top(bound('source="k.ssv"', '<d:ParameterMapping source="k.ssm"/>')),
        OUTER, [0, 0, 5, 10], (),
    ),
    "no type of a component": (
        top(GAIN.replace("<d:Component ", '<d:Component type="" ')), {}, TWICE, (),
    ),
    "another type of a component": (
        top(GAIN.replace("<d:Component ", '<d:Component type="application/x-ssp-package" ')),
        {}, TWICE, (),
    ),
    "an FMU for both kinds, wished as model exchange": (
        top(GAIN.replace("<d:Component ", '<d:Component implementation="ModelExchange" ')),
        {}, TWICE, (),
    ),
    "an implementation that is empty": (
        top(GAIN.replace("<d:Component ", '<d:Component implementation="" ')), {}, TWICE, (),
    ),
    "a unit that the file does not define": (
        top(component("gain", "gain", "u< furlong", "y>")),
        {}, TWICE, ("gain.u: its unit furlong is ignored, because the file does not define it",),
    ),
    "an empty unit": (
        top(component("gain", "gain", "u< X", "y>").replace('"X"', '""')), {}, TWICE, (),
    ),
    "a parameter in an undeclared unit": (
        top(component("gain", "gain", bindings=inline(ssv("k=4 furlong")))),
        {},
        [0, 0, 4, 8],
        ("gain.k: its unit furlong has no definition, so the value is not converted",),
    ),
    "no connectors at all": (
        top(component("gain", "gain"), count=component("count", "counter")), {}, TWICE, (),
    ),
    "a connection from the end to the start": (
        top(wires=["gain.u count.n"]), {}, TWICE, (),
    ),
    "a transformed signal": (
        top(wires=[f"count.n gain.u {linear(10, 1)}"]), {}, [2, 2, 22, 42], (),
    ),
    "other prefixes of namespaces": (
        top().replace("d:", "ssd:"), {}, TWICE, (),
    ),
}  # fmt: skip


def written(path, text, fmus, files):
    """A system; where its elements have the prefix ssd, so has its root."""
    write(path, text, fmus, files)
    if "<ssd:" in text:
        with zipfile.ZipFile(path) as archive:
            content = {name: archive.read(name) for name in archive.namelist()}
        ssd = content["SystemStructure.ssd"]
        content["SystemStructure.ssd"] = ssd.replace(b"xmlns:c", b'xmlns:ssd="%s"\n xmlns:c' % NAME)
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in content.items():
                archive.writestr(name, data)
    return path


NAME = b"http://ssp-standard.org/SSP1/SystemStructureDescription"


@pytest.mark.parametrize("dialect", DIALECTS)
def test_it_runs_with_the_right_numbers_and_the_log_states_the_warnings(
    fmus, tmp_path, caplog, capsys, dialect
):
    text, files, numbers, notes = DIALECTS[dialect]
    path = written(tmp_path / "third_party.ssp", text, fmus, files)
    result = run(path)
    assert result["gain.y"].tolist() == numbers
    for note in notes:
        assert any(message.startswith(note) for message in caplog.messages), caplog.messages
    assert notes or not caplog.messages
    assert np.array_equal(result.values, run(path, executor="python").values)
    assert main(["check", str(path)]) == 0
    reported = capsys.readouterr().err
    assert all(f"harness: warning: {note}" in reported for note in notes)
    assert main(["check", str(path), "--strict"]) == (1 if notes else 0)


def test_there_are_at_least_twelve():
    assert len(DIALECTS) >= 12


# ---- what stays rejected, by its name


def described(fmus, path, change, model=GAIN_MODEL):
    """An FMU, by default `gain`, with another description."""
    with zipfile.ZipFile(fmus[model.name]) as good, zipfile.ZipFile(path, "w") as archive:
        for name in good.namelist():
            if name != "modelDescription.xml":
                archive.writestr(name, good.read(name))
        archive.writestr("modelDescription.xml", change(description(model)))
    return path


def exchange_only(text):
    begin, end = text.index("<CoSimulation"), text.index("<UnitDefinitions>")
    return text[:begin] + '<ModelExchange modelIdentifier="gain"/>' + text[end:]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (exchange_only, "supports model exchange only; export it for co-simulation"),
        (
            lambda t: t.replace('fmiVersion="2.0"', 'fmiVersion="1.0"'),
            "FMI 1.0 is not supported; use an FMU of FMI 2.0 or FMI 3.0",
        ),
        (
            lambda t: t.replace('fmiVersion="2.0"', 'fmiVersion="4.0-beta"'),
            "FMI 4.0-beta is not supported; use an FMU of FMI 2.0 or FMI 3.0",
        ),
    ],
)
def test_fmus_of_other_kinds_are_named_as_such(fmus, tmp_path, change, line):
    other = described(fmus, tmp_path / "gain.fmu", change)
    path = write(tmp_path / "x.ssp", top(), fmus | {"gain": other})
    with pytest.raises(FmuError) as caught:
        run(path)
    assert str(caught.value) == f"gain: gain.fmu: {line}"


def test_a_component_that_is_no_fmu_stays_rejected_by_its_type(fmus, tmp_path):
    text = top(GAIN.replace("gain.fmu", "gain.csv").replace("<d:Comp", '<d:Comp type="text/csv"'))
    text = text.replace('<d:Comp type="text/csv"onent', '<d:Component type="text/csv"')
    path = write(tmp_path / "x.ssp", text, fmus, {"resources/gain.csv": "time,y"})
    with pytest.raises(StructureError, match="only FMUs can be run, not text/csv"):
        run(path)


def test_a_unit_of_the_fmu_gives_a_parameter_its_meaning(fmus, tmp_path):
    """Neither set nor system define the cable length, the FMU knows that it is 185.2 m."""
    cable = '<UnitDefinitions><Unit name="cable"><BaseUnit m="1" factor="185.2"/></Unit>'

    def with_cable(text):
        return text.replace("<UnitDefinitions>", cable, 1)

    other = described(fmus, tmp_path / "kilometres.fmu", with_cable, KILOMETRES)
    far = component("far", "kilometres", bindings=inline(ssv("k=10 cable")))
    path = write(tmp_path / "x.ssp", system("top", [far], []), fmus | {"kilometres": other})
    assert run(path)["far.y"].tolist() == [1.852] * 4


def test_signals_in_units_without_meaning_are_taken_as_they_are_with_a_warning(
    fmus, tmp_path, caplog
):
    def undefined(text):
        return text.replace('unit="1"', 'unit="furlong"', 1)

    other = described(fmus, tmp_path / "gain.fmu", undefined)
    path = write(tmp_path / "x.ssp", top(), fmus | {"gain": other})
    assert run(path)["gain.y"].tolist() == TWICE
    assert any("gain.u: not converted: 1 cannot be converted" in m for m in caplog.messages)
