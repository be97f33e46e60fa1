# SPDX-License-Identifier: BSD-2-Clause
"""Variants of a comparison."""

from __future__ import annotations

import pytest

from harness.errors import UsageError
from harness.studies.variants import combinations

SWAP = ("swap", "controller=a,b")


def labels(*varied):
    return [variant.label for variant in combinations({}, varied)]


def test_every_combination_is_simulated_the_last_option_changing_fastest():
    assert labels(("params", "calm, windy"), SWAP) == ["calm, a", "calm, b", "windy, a", "windy, b"]


def test_only_what_differs_is_in_the_label():
    assert labels(("params", "calm"), SWAP, ("algorithm", "jacobi")) == ["a", "b"]


def test_paths_are_labelled_by_their_stems_unless_these_are_equal():
    assert labels(("swap", "controller=x/mine.fmu,other")) == ["mine", "other"]
    assert labels(("swap", "controller=x/mine.fmu,y/mine.fmu")) == ["x/mine.fmu", "y/mine.fmu"]


def test_changes_match_a_run():
    last = combinations(
        {"set": ["a.b=1"], "stop": 3.0},
        [("params", "calm"), SWAP, ("swap", "plant=p"), ("latency", "plant=0,1")],
    )[-1]
    assert last.label == "b, plant 1 late"
    assert last.changes == {
        "set": ["a.b=1"],
        "stop": 3.0,
        "params": "calm",
        "swap": {"controller": "b", "plant": "p"},
        "latency": {"plant": "1"},
    }


def test_values_of_a_parameter_are_simulated_over_the_fixed_ones():
    variants = combinations(
        {"set": ["a.b=1", "a.k=0"]}, [("set", "a.k=1, 2"), ("set", "a.v=[1,2],[[3,4],[5,6]]")]
    )
    assert [variant.label for variant in variants][:2] == [
        "a.k=1, a.v=[1,2]",
        "a.k=1, a.v=[[3,4],[5,6]]",
    ]
    assert variants[-1].changes == {"set": {"a.b": "1", "a.k": "2", "a.v": "[[3,4],[5,6]]"}}


def test_a_range_of_values_has_both_its_ends():
    assert labels(("set", "a.k=0.1:0.3:0.05")) == [
        f"a.k={k}" for k in ("0.1", "0.15", "0.2", "0.25", "0.3")
    ]
    assert labels(("set", "a.k=2:0:-1,7")) == [f"a.k={k}" for k in (2, 1, 0, 7)]


@pytest.mark.parametrize("text", ["0:1:0", "0:1:x", "0:1:0.3", "0:1:-0.1", "0:inf:1"])
def test_a_range_that_is_none_is_wrong_use(text):
    with pytest.raises(UsageError, match=f"{text}: "):
        combinations({}, [("set", f"a.k={text}")])


def test_labels_are_file_names():
    assert combinations({}, [("swap", "c=x/m e.fmu,y/m e.fmu")])[0].file == "x_m_e.fmu"


@pytest.mark.parametrize(
    ("varied", "problem"),
    [
        ([], "there is nothing to compare: give several values"),
        ([("params", "calm"), ("swap", "controller=a")], "there is nothing to compare"),
        ([("swap", "a,b")], "--swap a,b: expected name=value"),
        ([("params", "calm,")], "--params calm,: a value is missing"),
        ([("swap", "c=a,b,a")], "--swap c=a,b,a: a is given twice"),
    ],
)
def test_a_mistaken_comparison_is_wrong_use(varied, problem):
    with pytest.raises(UsageError, match=problem):
        combinations({}, varied)


def test_every_variant_has_a_file_of_its_own():
    def files(*varied):
        return [variant.file for variant in combinations({}, varied)]

    assert files(("swap", "c=a b.fmu,a_b.fmu")) == ["a_b", "a_b-2"]
    assert files(("swap", "c=Pid.fmu,pid.fmu")) == ["Pid", "pid-2"]
    assert files(("params", "../../x,..")) == ["_.._x", "run"]
    assert all(len(name) <= 100 for name in files(("params", f"{'x' * 300},b")))
    assert files(("params", "hot,hot.partial")) == ["hot", "hot_partial"]


@pytest.mark.parametrize("values", ["1,+1", "1,1.0", "[1,2],[1, 2]"])
def test_equal_values_that_are_written_otherwise_have_labels_and_files_of_their_own(values):
    variants = combinations({}, [("set", f"a.at={values}")])
    assert len({variant.label for variant in variants}) == 2
    assert len({variant.file for variant in variants}) == 2


@pytest.mark.parametrize("name", ["step", "swap.controller", "latency.plant"])
def test_no_option_passes_for_a_parameter(name):
    with pytest.raises(UsageError, match=f"--vary {name}=1,2: {name} is an option; exp"):
        combinations({}, [("set", f"{name}=1,2")])


def test_labels_name_the_component_of_a_parameter_and_of_several_swaps():
    assert labels(("set", "a.k=1,2"), ("set", "b.k=1,2"))[0] == "a.k=1, b.k=1"
    assert labels(("swap", "a=x,y"), ("swap", "b=x,y"))[1] == "a=x, b=y"


@pytest.mark.parametrize("option", ["set", "swap", "latency"])
def test_an_option_that_is_given_twice_for_one_name_is_rejected(option):
    with pytest.raises(UsageError, match=r"a\.k: is given twice"):
        combinations({}, [(option, "a.k=1,2"), (option, "a.k=3,4")])
