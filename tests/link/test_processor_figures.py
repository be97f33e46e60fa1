# SPDX-License-Identifier: BSD-2-Clause
"""`harness processor`: the table of what FMUs take of a flight processor."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from harness.errors import UsageError
from harness.files.archive import pack
from harness.files.paths import fmus
from harness.master.calls import Cost
from harness.remote.firmware import PROCESSORS, Sizes, _sizes, sizes
from harness.studies import processor
from harness.studies.processor import HEAD, Row, compute_costs, digest, table
from tests.link.test_processor import needs
from tests.site.scripts import script

DOCS = Path(__file__).resolve().parents[2] / "docs"
markdown = script("processor_figures").markdown
MAP = """
Discarded input sections

 .text.unused   0x00000000       0x80 /tmp/x/component0.o

Linker script and memory map

 .text.step     0x00000040       0x10 /tmp/x/component0.o
 .text.a_function_with_a_long_name
                0x00000050       0x20 /tmp/x/component0.o
                0x00000050                a_function_with_a_long_name
 .rodata.start  0x00000070        0x8 /tmp/x/component0.o
 .bss.state     0x20000000        0x4 /tmp/x/component0.o
 .text.main     0x00000080       0x40 /tmp/ccABC.o
 .text          0x000000c0       0x30 /usr/lib/libgcc.a(_muldf3.o)
 .comment       0x00000000       0x26 /tmp/x/component0.o
"""


def test_sizes_are_sums_over_what_was_linked():
    assert _sizes(MAP) == (0x30, 0x8, 0x4, 0x30)


def test_an_fmu_that_runs_nowhere_needs_a_place():
    with pytest.raises(UsageError, match="propulsionless: there is no such FMU"):
        compute_costs(["propulsionless"], [])
    with pytest.raises(UsageError, match=r"expected SYSTEM\.COMPONENT"):
        compute_costs(["adaptive_controller"], [], place="controller")


def test_an_fmu_is_measured_again_where_the_page_states():
    places = {r["FMU"]: r["runs as"] for r in rows_of(DOCS / "processor_figures.md")}
    homes = {fmu: ".".join(home) for fmu, home in processor._homes().items()}
    assert len(places) >= 25
    assert {fmu: homes[fmu] for fmu in places} == places


OLDER = "older"
"""Digest of rows that were measured before the page had this column: `make processors` replaces
them.
"""


def test_no_row_is_older_than_the_code_of_its_fmu():
    """`make processors FLIGHT_FMUS=FMU` measures the rows of an FMU again."""
    digests = {(r["FMU"], r["sources"]) for r in rows_of(DOCS / "processor_figures.md")}
    stale = {fmu for fmu, found in digests if found not in (OLDER, digest(fmus()[fmu]))}
    assert stale == set()


def test_comments_do_not_change_a_digest(tmp_path):
    def packed(text):
        path = tmp_path / "a.fmu"
        pack(path, {"sources/a.c": text, "sources/buildDescription.xml": text})
        return digest(path)

    code = b"int f(void)\n{\n    return 1;\n}\n"
    assert packed(code) == packed(b"/* J.1-1 */\n" + code.replace(b"1;", b"1; /* one */"))
    assert packed(code) != packed(code.replace(b"1;", b"2;"))


def rows_of(page):
    lines = [x for x in page.read_text(encoding="utf-8").splitlines() if x.startswith("|")]
    titles, _, *found = ([cell.strip() for cell in x.strip("|").split("|")] for x in lines)
    return [dict(zip(titles, cells, strict=True)) for cells in found]


def row(fmu, target, largest, until=None):
    cost = Cost(600, 600 * 1000, largest, 3.0, 500, 8104, 0)
    place = "sync_approach.controller"
    return Row(fmu, target, place, Sizes(1, 2, 3, 4), cost, 0.1, 400e6, 601, until, "", "abc")


def test_a_page_has_the_rows_in_order_of_fmus_and_processors():
    rows = [row("b", "riscv32", 1), row("b", "cortex-m7", 4000, 60.0), row("a", "riscv64", 3)]
    page = markdown([*rows, row("a", "cortex-m7", 5)])
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line[:1] == "|"]
    assert tuple(lines[0]) == HEAD
    assert [(line[0], line[1], line[8]) for line in lines[2:]] == [
        ("a", "cortex-m7", "5"),
        ("a", "riscv64", "3"),
        ("b", "cortex-m7", "4 000"),
        ("b", "riscv32", "1"),
    ]
    assert [line[-2] for line in lines[4:]] == ["yes, 601 rows (to 60 s)", "yes, 601 rows"]
    assert page.startswith(
        (DOCS / "processor_figures.md").read_text(encoding="utf-8").partition("| FMU")[0]
    )
    assert {line[-1] for line in lines[2:]} == {"abc"}
    assert float(lines[4][-3]) == 0.01  # percent: 4000 instructions of 400e6 Hz * 0.1 s


def test_rows_of_a_page_for_other_fmus_and_processors_remain():
    earlier = markdown([row("a", "cortex-m7", 5), row("b", "cortex-m7", 6), row("b", "riscv64", 7)])
    assert markdown([], earlier) == earlier
    page = markdown([row("b", "cortex-m7", 4000), row("c", "riscv32", 9)], earlier)
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line[:1] == "|"]
    assert [(line[0], line[1], line[8]) for line in lines[2:]] == [
        ("a", "cortex-m7", "5"),
        ("b", "cortex-m7", "4 000"),
        ("b", "riscv64", "7"),
        ("c", "riscv32", "9"),
    ]


@needs("cortex-m7")
def test_fmus_of_a_system_run_together_and_once(monkeypatch):
    simulated, simulate = [], processor._costed_run
    monkeypatch.setattr(processor, "_costed_run", lambda *of: simulated.append(of) or simulate(*of))
    required = ["pid_controller", "sync_guidance", "adaptive_controller"]
    rows = compute_costs(required, ["cortex-m7"], stop=2.0)
    assert [r.fmu for r in rows] == required
    assert [(r.rows, r.difference) for r in rows] == [(41, ""), (21, ""), (21, "")]
    assert [list(of[1]) for of in simulated if len(of) > 1] == [
        ["controller"],
        ["guidance", "controller"],
    ]
    assert compute_costs(required, ["cortex-m7"], stop=2.0) == rows
    assert len(simulated) == 4  # two systems here and there; the second time nothing


@pytest.mark.parametrize("clock", [0.0, -1.0, float("nan"), float("inf")])
def test_a_clock_that_does_not_tick_is_rejected(clock):
    with pytest.raises(UsageError, match=r"--clock .*: expected a frequency above 0"):
        compute_costs(["adaptive_controller"], ["cortex-m7"], clock=clock)


@needs("cortex-m7")
def test_a_difference_is_reported_with_its_place(monkeypatch):
    wrong = processor._costed_run

    def simulated(system, linked=()):
        result, costs = wrong(system, linked)
        if not linked:
            values = result.values.copy()
            values[7, result.columns.index("controller.F_cmd_S[2]")] += 1e-12
            result = replace(result, values=values)
        return result, costs

    monkeypatch.setattr(processor, "_costed_run", simulated)
    (one,) = compute_costs(["adaptive_controller"], ["cortex-m7"], stop=1.5)
    assert one.difference == "controller.F_cmd_S[2] at 0.7 s"
    assert one.verdict() == "no: controller.F_cmd_S[2] at 0.7 s"


@pytest.mark.pil
@needs("cortex-m7", "cortex-m4")
def test_the_table_of_a_controller(tmp_path):
    mine = shutil.copy(fmus()["adaptive_controller"], tmp_path / "mine.fmu")
    place = {"place": "sync_approach.controller", "stop": 5.0}
    hard, soft = compute_costs([str(mine)], ["cortex-m7", "cortex-m4"], **place)
    assert not hard.difference
    assert not soft.difference
    assert hard.cost.steps == soft.cost.steps == 50
    assert 2000 < hard.cost.mean <= hard.cost.largest < 0.1 * soft.cost.largest
    assert 500 < hard.cost.stack < 40000
    assert hard.share == pytest.approx(hard.cost.largest / 400e6 / 0.1)
    text = table([hard, soft])
    assert [line.split()[0] for line in text.splitlines()] == ["FMU", "mine", "mine"]
    assert text.count("yes, 51 rows (to 5 s)") == 2


@pytest.mark.pil
@needs("cortex-m7", "cortex-m4")
def test_software_doubles_are_code_of_the_library():
    """Products, comparisons and conversions are of libgcc; the rest is ours (soft_double.c)."""
    found = sizes(fmus()["adaptive_controller"], PROCESSORS["cortex-m4"])
    hard = sizes(fmus()["adaptive_controller"], PROCESSORS["cortex-m7"])
    assert found.code > hard.code
    assert found.library > hard.library + 500
