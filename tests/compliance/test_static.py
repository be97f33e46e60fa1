# SPDX-License-Identifier: BSD-2-Clause
"""The model description: what tools check, and what no tool checks (units, bounds, nominal values,
texts).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from datetime import datetime
from functools import cache
from itertools import groupby
from pathlib import Path

import fmpy
import pytest
from lxml import etree

from tests.compliance import description, units
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Instance
from tests.validators import problems

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"
STRUCTURED_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(\[[1-9]\d*(,[1-9]\d*)?\])?", re.ASCII)


# ---- schemas and validators


def test_fmpy_reports_no_problem(archive):
    assert problems(archive) == []


@cache
def schema():
    return etree.XMLSchema(etree.parse(str(SCHEMA)))


def test_the_model_description_retains_the_schema(about):
    document = etree.fromstring(description.ElementTree.tostring(about.root))
    assert schema().validate(document), schema().error_log


# ---- header


def test_model_and_library_are_called_like_the_file(archive, about):
    assert about.identifier == about.root.attrib["modelName"] == archive.stem


def test_the_header_states_content_and_origin(about):
    required = ("description", "author", "version", "license", "copyright", "generationTool")
    assert [key for key in required if not about.root.get(key, "").strip()] == []
    assert about.root.attrib["fmiVersion"] == "2.0"
    assert about.root.attrib["variableNamingConvention"] == "structured"


def test_the_date_of_generation_is_a_date_in_universal_time(about):
    text = about.root.attrib["generationDateAndTime"]
    assert datetime.strptime(text, "%Y-%m-%dT%H:%M:%SZ").strftime("%Y-%m-%dT%H:%M:%SZ") == text


def test_the_capabilities_that_users_rely_on_are_announced(about):
    for capability in ("VariableCommunicationStepSize", "GetAndSetFMUstate", "SerializeFMUstate"):
        prefix = "canHandle" if capability.startswith("Variable") else "can"
        assert about.co_simulation.get(prefix + capability) == "true"
    assert about.co_simulation.get("providesDirectionalDerivative") == "true"
    assert about.co_simulation.get("needsExecutionTool", "false") == "false"
    assert about.co_simulation.get("canBeInstantiatedOnlyOncePerProcess", "false") == "false"


def test_the_log_categories_are_the_standard_ones_that_are_used(about):
    categories = [
        (c.attrib["name"], c.get("description", ""))
        for c in about.root.findall("LogCategories/Category")
    ]
    assert {name for name, _ in categories} == {"logStatusError", "logStatusWarning", "logEvents"}
    assert all(text for _, text in categories)


def test_the_default_experiment_is_a_run_of_positive_steps(about):
    (experiment,) = about.root.findall("DefaultExperiment")
    start, stop, step = (
        float(experiment.attrib[key]) for key in ("startTime", "stopTime", "stepSize")
    )
    assert 0 < step <= stop - start < math.inf


def test_the_guid_of_every_fmu_is_its_own():
    guids = [description.read(path).guid for path in ARCHIVES]
    assert all(
        re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", guid) for guid in guids
    )
    assert len(set(guids)) == len(guids)


# ---- variables


def test_names_are_legal_and_unique(about):
    assert [v.name for v in about.variables if not STRUCTURED_NAME.fullmatch(v.name)] == []
    assert [
        name for name, count in Counter(v.name for v in about.variables).items() if count > 1
    ] == []
    assert "time" not in about.by_name, (
        "libcosim reports an error for a listed independent variable"
    )


def test_elements_of_vectors_and_matrices_are_complete_and_in_order(about):
    for row, group in groupby(about.variables, key=lambda v: v.row):
        indices = [tuple(map(int, re.findall(r"\d+", v.name[len(row) :]))) for v in group]
        last = indices[-1]
        expected = [()] if not last else [(i,) for i in range(1, last[0] + 1)]
        if len(last) == 2:
            expected = [(i, j) for i in range(1, last[0] + 1) for j in range(1, last[1] + 1)]
        assert indices == expected, row


def test_value_references_are_a_thousand_per_row_and_one_per_element(about):
    rows = [list(group) for _, group in groupby(about.variables, key=lambda v: v.row)]
    expected = {v.name: 1000 * i + k for i, row in enumerate(rows) for k, v in enumerate(row)}
    assert {v.name: v.reference for v in about.variables} == expected


def test_causality_variability_and_initial_are_one_of_three_kinds(about):
    kinds = {(v.causality, v.variability, v.initial, v.start is None) for v in about.variables}
    varying = [
        kind
        for changes in ("continuous", "discrete")
        for kind in (("input", changes, None, False), ("output", changes, "calculated", True))
    ]
    assert kinds <= {("parameter", "fixed", "exact", False), *varying}


def test_every_variable_has_a_text_that_states_more_than_its_name(about):
    assert [
        v.name for v in about.variables if len(v.text.strip()) < 4 or v.text.strip() == v.row
    ] == []
    assert [v.name for v in about.variables if "  " in v.text or v.text != v.text.strip()] == []


def test_start_values_retain_the_declared_bounds(about):
    assert [
        v.name for v in about.variables if v.start is not None and not v.low <= v.start <= v.high
    ] == []
    assert [v.name for v in about.variables if not math.isfinite(v.start or 0)] == []


def test_nominal_values_are_of_the_size_of_the_first_values(fmu):
    """Within a factor of four of the largest first value of the row, where that is far from 1."""
    with Instance(fmu) as instance:
        outputs = dict(
            zip((v.name for v in fmu.outputs), instance.start().values(fmu.outputs), strict=True)
        )
    for row, group in groupby(fmu.about.variables, key=lambda v: v.row):
        elements = list(group)
        size = max(abs(outputs[v.name] if v.start is None else v.start) for v in elements)
        assert all(0 < v.nominal < math.inf for v in elements), row
        if size and not 10**-1.5 < size < 10**1.5:
            assert all(size / 4 <= v.nominal <= 4 * size for v in elements), (
                row,
                size,
                elements[0].nominal,
            )


# ---- units and bounds


def unit_definitions(about):
    return {unit.attrib["name"]: unit for unit in about.root.findall("UnitDefinitions/Unit")}


def test_every_variable_has_a_unit_that_is_defined(about):
    assert [v.name for v in about.variables if v.unit not in unit_definitions(about)] == []
    assert set(unit_definitions(about)) == {v.unit for v in about.variables}


def test_base_units_are_the_dimension_of_the_unit_text(about):
    for name, unit in unit_definitions(about).items():
        (base,) = unit.findall("BaseUnit")
        powers = {key: int(value) for key, value in base.attrib.items()}
        assert powers.pop("factor", 1) == 1
        assert powers.pop("offset", 0) == 0
        assert powers == units.dimension(name), name


@pytest.mark.parametrize(
    ("unit", "dimension"),
    [
        ("1", {}),
        ("1/s", {"s": -1}),
        ("N.m.s", {"kg": 1, "m": 2, "s": -1}),
        ("m3/s2", {"m": 3, "s": -2}),
        ("kg.s2/m2", {"kg": 1, "s": 2, "m": -2}),
        ("rad/s2", {"rad": 1, "s": -2}),
        ("m/(s2.rad)", {"m": 1, "s": -2, "rad": -1}),
    ],
)
def test_unit_texts_are_read_like_a_physicist_reads_them(unit, dimension):
    assert units.dimension(unit) == dimension


@pytest.mark.parametrize("text", ["", "m/", "m^2", "furlong", "kg m", "m/s/s", "m/s.kg", "m1"])
def test_texts_that_are_not_units_are_rejected(text):
    with pytest.raises(ValueError, match=r"unknown factor|behind the slash"):
        units.dimension(text)


def test_angles_and_rates_can_be_displayed_in_degrees(about):
    for name, degrees in (("rad", "deg"), ("rad/s", "deg/s")):
        if name in unit_definitions(about):
            (display,) = unit_definitions(about)[name].findall("DisplayUnit")
            assert (display.attrib["name"], float(display.attrib["factor"])) == (
                degrees,
                math.degrees(1),
            )
        assert {v.display_unit for v in about.variables if v.unit == name} <= {degrees}


BOUNDS = {
    r"mass|mass_0|m_hat_0|range|mu|R_E|J2|a|e|rho_M|rho_0|mdot|Isp|tau|max_step|sample_period": (
        0,
        math.inf,
    ),
    r"impulse|torque_impulse": (0, math.inf),
    r"(?!joint_angle).*_max": (0, math.inf),
    r"use_.*|know_.*|.*_saturated|.*_axes|attitude_guard|projection": (0, 1),
    r"beta_[tp]": (0, math.pi),
}
"""Rows that physics or their meaning bounds, by name: masses, distances, impulses, limits,
switches, angles between vectors.
"""


def physical_bound(row):
    return next((bound for pattern, bound in BOUNDS.items() if re.fullmatch(pattern, row)), None)


def test_variables_that_physics_bounds_declare_the_bound(about):
    wrong = [
        v.name
        for v in about.variables
        if (bound := physical_bound(v.row)) and (v.low, v.high) != bound
    ]
    assert wrong == []


def test_every_rule_for_bounds_is_used_by_some_fmu():
    rows = {row for path in ARCHIVES for row in description.read(path).rows}
    assert [
        pattern for pattern in BOUNDS if not any(re.fullmatch(pattern, row) for row in rows)
    ] == []


# ---- structure


def test_outputs_and_initial_unknowns_are_exactly_the_outputs(about):
    indices = [i for i, v in enumerate(about.variables, 1) if v.causality == "output"]
    structure = about.root.find("ModelStructure")
    outputs, unknowns = (
        structure.findall("Outputs/Unknown"),
        structure.findall("InitialUnknowns/Unknown"),
    )
    assert [int(u.attrib["index"]) for u in outputs] == indices
    assert [u.attrib.get("dependencies") for u in outputs] == [""] * len(indices)
    assert [int(u.attrib["index"]) for u in unknowns] == indices
    assert structure.find("Derivatives") is None
