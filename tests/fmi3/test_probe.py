# SPDX-License-Identifier: BSD-2-Clause
"""Every FMU of FMI 3.0 does what FMI 3.0 and this project demand; its bits equal the bits of FMI
2.0.
"""

from __future__ import annotations

import ctypes

import pytest

from tests.compliance.fmus import BUILD
from tests.compliance.probe import Fmu as Fmu2
from tests.compliance.probe import Instance as Instance2
from tests.compliance.probe import excitation
from tests.each import Each
from tests.fmi3 import probe
from tests.fmi3.fmus import ARCHIVES
from tests.fmi3.probe import Fmu, Instance


@pytest.fixture(scope="module")
def archive():
    return Each(ARCHIVES, lambda path: path.stem)


def test_every_model_is_there_in_both_versions():
    assert {path.name for path in (BUILD / "fmus3").glob("*.fmu")} == {
        path.name for path in (BUILD / "fmus").glob("*.fmu")
    }


def test_demands_are_fulfilled(archive):
    assert probe.failures(archive) == []


def test_there_are_enough_demands():
    assert len(probe.PROBES) + len(probe.OWN) >= 45


def test_a_broken_demand_would_be_seen(monkeypatch):
    def never(_):
        raise AssertionError("never")

    monkeypatch.setattr(probe, "PROBES", [never])
    assert probe.failures(ARCHIVES[0])[0].endswith("never: never")


def recordings(path, folder, steps):
    """Outputs after every step, and the bytes of the last state: FMI 2.0, then FMI 3.0."""
    two = Fmu2(BUILD / "fmus" / path.name, folder / "2")
    three = Fmu(path, folder / "3")
    inputs = three.of("input")
    elements = iter(two.inputs)
    rows = {v.name: [next(elements).name for _ in range(v.size)] for v in inputs}
    records = b"", b""
    with Instance2(two) as one, Instance(three) as other:
        one.start(), other.start()
        for k in range(steps):
            values = excitation(two.inputs, k)
            one.set(values)
            assert other.set(inputs, [values[e] for v in inputs for e in rows[v.name]]) == probe.OK
            one.step(0.1 * k, 0.1)
            assert other.step(0.1 * k)[0] == probe.OK, other.messages
            records = records[0] + one.outputs(), records[1] + other.outputs()
        state = other.save()
        serialized = one.snapshot(), other.serialize(state)
        other.ok("FreeFMUState", ctypes.byref(state))
    return (records[0], serialized[0]), (records[1], serialized[1])


def test_bits_and_states_match_fmi_2(archive, tmp_path):
    two, three = recordings(archive, tmp_path / archive.stem, 20)
    assert two == three


@pytest.mark.long
def test_bits_of_a_thousand_steps_match_fmi_2(archive, tmp_path):
    two, three = recordings(archive, tmp_path / archive.stem, 1000)
    assert two == three
