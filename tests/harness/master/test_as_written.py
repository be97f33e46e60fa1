# SPDX-License-Identifier: BSD-2-Clause
"""Values of a user reach the FMU as they are written, or are rejected."""

from __future__ import annotations

import numpy as np
import pytest

from harness.cli.app import main
from harness.errors import UsageError
from harness.master.changes import apply
from harness.master.isolated import simulate
from harness.system.values import Grid, assign, coerce, grid, parts_of


def value_of(system, name):
    return system.component("a").parameters[name].value


@pytest.mark.parametrize("text", ["1", "1.0", "true", "01", "1e3", "2020-01-01", "x y", "[1,2]"])
def test_strings_are_not_altered(make, text):
    changed = apply(make({"a": "mixed"}), set=[f"a.label={text}"])
    assert value_of(changed, "label") == text


def test_quotes_of_toml_are_no_part_of_a_string(make):
    assert value_of(apply(make({"a": "mixed"}), set=['a.label="1"']), "label") == "1"


@pytest.mark.parametrize("number", [2**31, -(2**31) - 1, 2**32 + 5, 10**400])
def test_integers_beyond_32_bits_are_rejected(make, number):
    with pytest.raises(UsageError, match=r"a\.offset: "):
        apply(make({"a": "mixed"}), set=[f"a.offset={number}"])
    with pytest.raises(ValueError, match=r"beyond|exceeds the range"):
        coerce(number, "Integer")


@pytest.mark.parametrize("number", [2**31 - 1, -(2**31), 0])
def test_the_largest_integers_reach_the_fmu_and_the_file(make, number):
    result = simulate(apply(make({"a": "mixed"}), set=[f"a.offset={number}"], stop=1.0))
    assert result["a.n"][0] == number
    assert result.parameter("a.offset") == number


def test_a_value_for_a_driven_input_is_rejected(make):
    system = make({"a": "counter", "b": "gain"}, ["a.n > b.u"])
    with pytest.raises(UsageError, match=r"--set b\.u: is driven by a\.n"):
        apply(system, set=["b.u=3"])


@pytest.mark.parametrize("first", [0, 1, 5])
def test_values_go_to_the_elements_in_order_wherever_these_begin(first):
    known = [f"v[{i + first}]" for i in range(3)]
    assert list(assign("v", [7, 8, 9], known).items()) == list(zip(known, [7, 8, 9], strict=True))


def test_names_with_blanks_between_indices_are_elements_too():
    assert assign("J", [[1, 2], [3, 4]], ["J[1, 1]", "J[1, 2]", "J[2, 1]", "J[2, 2]"]) == {
        "J[1, 1]": 1,
        "J[1, 2]": 2,
        "J[2, 1]": 3,
        "J[2, 2]": 4,
    }


def test_a_grid_is_whole_or_none():
    assert grid([(0, 0), (0, 1), (1, 0), (1, 1)]) == Grid((0, 0), (2, 2))
    assert grid([(1,), (3,)]) is None
    assert grid([(1,), (4_000_000_00,)]) is None
    assert grid([(), (1,)]) is None
    assert Grid((0, 1), (2, 2)).place((1, 1)) == (1, 0)


@pytest.mark.parametrize(
    "text", ["x[4000000000]", "x[²]", "x[-1]", "x[]", "[1]", "x[1][2]", "x[01]"]
)
def test_odd_names_are_read_without_harm(text):
    name = parts_of(text)
    assert isinstance(name.variable, str)
    assert np.prod(name.element or (1,)) >= 0


@pytest.mark.parametrize(
    "options",
    [
        ("--params", "a", "--params", "b"),
        ("--stop", "1", "--stop", "2"),
        ("-o", "a.nc", "-o", "b.nc"),
    ],
)
def test_an_option_with_one_value_is_rejected_twice(capsys, options):
    assert main(["run", "sync_approach", *options]) == 2
    assert (
        capsys.readouterr().err
        == f"harness: {'--output' if options[0] == '-o' else options[0]} is given twice\n"
    )


@pytest.mark.parametrize("option", ["--set", "--swap", "--latency"])
def test_one_name_is_rejected_twice(capsys, option):
    name = {"--set": "controller.K"}.get(option, "controller")
    value = {"--set": "1", "--swap": "adaptive_controller", "--latency": "0"}[option]
    assert main(["run", "sync_approach", *2 * (option, f"{name}={value}")]) == 2
    assert f"{option} {name}: is given twice" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["\udce4", "a\0b"])
def test_texts_that_c_cannot_hold_are_rejected(make, text):
    with pytest.raises(UsageError, match=r"a\.label: .*(UTF-8|zero character)"):
        apply(make({"a": "mixed"}), set=[f"a.label={text}"])


def test_a_text_beyond_ascii_reaches_the_fmu(make):
    assert simulate(apply(make({"a": "mixed"}), set=["a.label=ü€"], stop=1.0)).complete
