# SPDX-License-Identifier: BSD-2-Clause
"""The descriptions of FMI 2.0 and FMI 3.0 of an FMU, field by field, and the modes in them."""

from __future__ import annotations

import zipfile

import pytest
from lxml import etree

from harness.files import paths
from harness.system.interface import read_interface
from tests.each import each

FIELDS = ("unit", "displayUnit", "min", "max", "nominal")
ROOT = ("modelName", "description", "author", "version", "copyright", "license", "generationTool",
        "generationDateAndTime", "variableNamingConvention")  # fmt: skip
PHASES = "far|hold 1|closing|hold 2|fly-around|final|hold 3|mating|rigidise|detumble|stack"


def root_of(path):
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read("modelDescription.xml"))


def listed(annotations):
    """Return the elements that tools of this project read, as text."""
    return [etree.tostring(each).strip() for each in annotations]


def of_fmi2(root):
    """Return the fields of every element by name, in order."""
    return {
        v.get("name"): {
            "reference": int(v.get("valueReference")),
            **{name: v.get(name) for name in ("causality", "variability", "description")},
            **{name: v[0].get(name) for name in FIELDS},
            "start": v[0].get("start"),
            "annotations": listed(v.iterfind("Annotations/Tool/*")),
        }
        for v in root.iterfind("ModelVariables/ScalarVariable")
    }


def of_fmi3(root):
    """Return the fields of every element of every array, as FMI 2.0 would list it."""
    found = {}
    for v in root.iterfind("ModelVariables/Float64"):
        if v.get("causality") == "independent":
            continue
        shape = [int(d.get("start")) for d in v.iterfind("Dimension")]
        indices = [[]]
        for size in shape:
            indices = [[*index, k + 1] for index in indices for k in range(size)]
        starts = (v.get("start") or "").split() or [None] * len(indices)
        for k, index in enumerate(indices):
            place = f"[{','.join(map(str, index))}]" if index else ""
            found[v.get("name") + place] = {
                "reference": int(v.get("valueReference")) + k,
                **{name: v.get(name) for name in ("causality", "variability", "description")},
                **{name: v.get(name) for name in FIELDS},
                "start": starts[k],
                "annotations": listed(v.iterfind("Annotations/Annotation/*")),
            }
    return found


@each("name", sorted(paths.fmus()))
def test_both_descriptions_differ_by_the_version_only(name):
    two = root_of(paths.fmus()[name])
    three = root_of(paths.fmus()[name].parent.parent / "fmus3" / f"{name}.fmu")
    one, other = of_fmi2(two), of_fmi3(three)
    assert list(one) == list(other)
    for variable, fields in one.items():
        assert fields == other[variable], variable
    texts = [[r.get(k, "").replace("documentation/", "") for k in ROOT] for r in (two, three)]
    assert texts[0] == texts[1]
    assert two.get("guid") == three.get("instantiationToken")
    times = [dict(root.find("DefaultExperiment").attrib) for root in (two, three)]
    assert times[0] == times[1]


@pytest.mark.parametrize("name", ["mission_manager", "command_selector"])
def test_what_must_not_be_interpolated_is_discrete(name):
    kinds = {v: f["variability"] for v, f in of_fmi2(root_of(paths.fmus()[name])).items()}
    interface = read_interface(paths.fmus()[name])
    assert {kinds[v] for v in interface.outputs()} == {"discrete"}
    assert kinds["select_force"] == "discrete"
    positions = [v for v in interface.named("input") if v.startswith(("r_", "F_", "v_"))]
    assert positions
    assert {kinds[v] for v in positions} == {"continuous"}


@pytest.mark.parametrize("name", ["los_guidance", "ppc_controller", "pid_controller"])
def test_every_output_of_a_sampled_model_is_discrete(name):
    """Also outputs with a point in their name, such as los.range."""
    found = of_fmi2(root_of(paths.fmus()[name]))
    outputs = {n: v["variability"] for n, v in found.items() if v["causality"] == "output"}
    assert any("." in output for output in outputs)
    assert set(outputs.values()) == {"discrete"}


def test_a_mode_has_its_names_limits_and_text():
    found = of_fmi2(root_of(paths.fmus()["mission_manager"]))
    phase, force = found["phase"], found["select_force"]
    assert (phase["min"], phase["max"], force["min"], force["max"]) == ("0", "14", "0", "6")
    assert force["description"] == (
        "source of the force, none in law 4 (stack): "
        "0 none, 1 far, 2 close, 3 sync, 4 none, 5 retreat, 6 optimal"
    )
    variables = read_interface(paths.fmus()["mission_manager"]).variables
    assert variables["phase"].modes.startswith(PHASES)
    assert variables["select_force"].modes == "none|far|close|sync|none|retreat|optimal"
    assert not variables["t_phase"].modes
