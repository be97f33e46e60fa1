# SPDX-License-Identifier: BSD-2-Clause
"""The diagram of a system: every signal in the field between its components, nothing over anything
else.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import pytest
from lxml import etree

from harness.cli.app import main
from harness.errors import UsageError
from harness.figures.diagram import CHARACTER, LINE, draw, lay_out, painted, texts

LOOP = (
    {"a": "ladder", "b": "ladder", "c": "ladder"},
    [f"a.w[{i}] > b.v[{i}]" for i in (1, 2, 3)] + [f"b.w[{i}] > c.v[{i}]" for i in (1, 2)]
    + ["b.w[3] > a.v[1]", "c.w[1] > a.v[2]", "c.w[2] > b.v[2]", "a.w[1] > c.v[3]"],
)  # fmt: skip


def test_vectors_are_one_signal_and_components_are_on_the_diagonal(make):
    assert texts(make(*LOOP)) == {
        (0, 0): ["a", "ladder"],
        (1, 1): ["b", "ladder"],
        (2, 2): ["c", "ladder"],
        (0, 1): ["w > v"],
        (1, 2): ["w > v"],
        (1, 0): ["w > v"],
        (2, 0): ["w > v"],
        (2, 1): ["w > v"],
        (0, 2): ["w > v"],
    }


def test_a_connection_of_a_component_to_itself_is_in_its_block(make):
    system = make({"a": "ladder"}, ["a.w[1] > a.v[2]"])
    assert texts(system) == {(0, 0): ["a", "ladder", "w > v"]}


def test_no_field_touches_another_and_every_text_is_inside_of_its_own(make):
    fields = lay_out(make(*LOOP))
    for field in fields.values():
        assert min(field.x, field.y) > 0
        assert CHARACTER * max(map(len, field.lines)) < field.width
        assert LINE * len(field.lines) < field.height
    for one, other in combinations(fields.values(), 2):
        beside = one.x + one.width < other.x or other.x + other.width < one.x
        assert beside or one.y + one.height < other.y or other.y + other.height < one.y


def test_the_picture_names_components_and_signals_and_is_always_the_same(make, tmp_path):
    system = make({"first": "counter", "second": "gain"}, ["first.n > second.u"])
    draw(system, tmp_path / "new" / "x.svg")
    data = (tmp_path / "new" / "x.svg").read_bytes()
    assert data == painted(system)
    words = [e.text for e in etree.fromstring(data).iter("{*}text")]
    assert words == ["test", "first", "counter", "second", "gain", "n > u"]


@pytest.mark.parametrize("arguments", [[], ["-o", "y.svg"]])
def test_the_command_writes_a_picture_beside(make, tmp_path, monkeypatch, capsys, arguments):
    from harness.ssp.writer import write_ssp

    monkeypatch.chdir(tmp_path)
    write_ssp(make(*LOOP), tmp_path / "loop.ssp")
    assert main(["draw", "loop.ssp", *arguments]) == 0
    name = arguments[-1] if arguments else "test.svg"
    assert capsys.readouterr().out == f"{name}\n"
    assert (tmp_path / name).read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(("ending", "head"), [("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_the_ending_states_the_format(make, tmp_path, ending, head):
    path = tmp_path / f"x.{ending}"
    draw(make(*LOOP), path)
    assert path.read_bytes().startswith(head)


@pytest.mark.parametrize("name", ["x.jpg", "x"])
def test_another_ending_is_reported_in_one_line_and_no_file(make, tmp_path, name):
    with pytest.raises(UsageError, match=r"as \.svg, \.pdf, \.png, not as"):
        draw(make(*LOOP), tmp_path / name)
    assert not any(tmp_path.iterdir())


def test_a_long_title_continues_in_lines_within_the_picture(make):
    system = replace(make({"a": "counter"}), description="many words " * 20)
    root = etree.fromstring(painted(system))
    width = float(root.get("viewBox").split()[2]) * 96 / 72  # points to pixels
    lines = [e.text for e in root.iter("{*}text")][:-2]
    assert " ".join(lines) == f"test: {'many words ' * 20}".strip()
    assert max(map(len, lines)) * CHARACTER < width


def test_another_fmu_is_drawn_in_its_place(tmp_path):
    path = tmp_path / "x.svg"
    swap = ["--swap", "controller=pid_controller"]
    assert main(["draw", "sync_approach", *swap, "-o", str(path)]) == 0
    words = {e.text for e in etree.fromstring(path.read_bytes()).iter("{*}text")}
    assert "pid_controller" in words
    assert "adaptive_controller" not in words
    assert main(["draw", "sync_approach", "--swap", "nobody=pid_controller"]) != 0
