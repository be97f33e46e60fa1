# SPDX-License-Identifier: BSD-2-Clause
"""`harness target`: the table of what FMUs take of a flight processor."""

from __future__ import annotations

import shutil

import pytest

from harness.errors import UsageError
from harness.files.paths import fmus
from harness.remote.firmware import _sizes, sizes
from harness.remote.targets import TARGETS
from harness.studies.target import HEAD, markdown, measure, table
from tests.link.test_processor import needs

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


def test_an_fmu_that_flies_nowhere_needs_a_place():
    with pytest.raises(UsageError, match="propulsionless: there is no such FMU"):
        measure(["propulsionless"], [])
    with pytest.raises(UsageError, match=r"expected SYSTEM\.COMPONENT"):
        measure(["adaptive_controller"], [], place="controller")


@pytest.mark.pil
@needs("cortex-m7", "cortex-m4")
def test_the_table_of_a_controller(tmp_path):
    mine = shutil.copy(fmus()["adaptive_controller"], tmp_path / "mine.fmu")
    place = {"place": "sync_approach.controller", "stop": 5.0}
    hard, soft = measure([str(mine)], ["cortex-m7", "cortex-m4"], **place)
    assert not hard.difference
    assert not soft.difference
    assert hard.cost.steps == soft.cost.steps == 50
    assert 2000 < hard.cost.mean <= hard.cost.largest < 0.1 * soft.cost.largest
    assert 500 < hard.cost.stack < 40000
    assert hard.share == pytest.approx(hard.cost.largest / 400e6 / 0.1)
    text, page = table([hard, soft]), markdown([hard, soft], 5.0)
    assert [line.split()[0] for line in text.splitlines()] == ["FMU", "mine", "mine"]
    assert page.count("yes, 51 rows") == 2
    assert " | ".join(HEAD) in page


@pytest.mark.pil
@needs("cortex-m7", "cortex-m4")
def test_software_doubles_are_code_of_the_library():
    found = sizes(fmus()["adaptive_controller"], TARGETS["cortex-m4"])
    hard = sizes(fmus()["adaptive_controller"], TARGETS["cortex-m7"])
    assert found.code > hard.code
    assert found.library > hard.library + 2000
