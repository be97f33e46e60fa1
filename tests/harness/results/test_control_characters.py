# SPDX-License-Identifier: BSD-2-Clause
"""Names and texts with control characters: every file returns them, or reports that it cannot."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from harness.errors import ResultsError
from harness.results.files import FORMATS, read
from harness.results.provenance import Provenance
from harness.results.result import Result
from harness.spelling import one_line
from harness.studies.compare import read_csv, table, write_csv

CONTROLS = [chr(code) for code in (*range(0x20), *range(0x7F, 0xA0))]
LIKE_CONTROLS = ["\u200b", "\u200e", "\u2028", "\u2029", "\ufeff", "\u00a0", "\u3000"]
ODD = [*CONTROLS, *LIKE_CONTROLS, " ", '"', "'", ",", "#", "\\", "\\n", "\\\\", "\r\n", "\n\r"]
"""\\n and \\\\: what represents a line break or a backslash elsewhere."""

REJECTED = {".nc": [*CONTROLS[:33], " ", "\r\n", "\n\r"]}
"""Characters that a kind of file rejects in names."""


def named(*odds):
    """Three rows whose names, units and texts have odd characters everywhere."""
    names, texts, whole = [], [], "|".join(odds)
    for i, odd in enumerate(odds):
        names += [f"a{i}.{odd}x", f"a{i}.x{odd}", f"a{i}.{odd}", f"a{i}.w{odd}[0]"]
        names += [f"a{i}.v{odd}[1]", f"a{i}.v{odd}[2]"]
        texts += [f"{place}{odd}text{odd}" for place in "abcdee"]
    fixed = tuple(f"a{i}.k{odd}" for i, odd in enumerate(odds))
    gains = Result("s", np.zeros(1), fixed, ("m",) * len(odds), np.full((1, len(odds)), 7.0), fixed)
    origin = Provenance(system=whole, source=f"x{whole}y.ssp", set=(("a.k", f"1{whole}2"),))
    values = np.arange(3.0 * len(names)).reshape(3, -1)
    return Result(
        whole,
        np.arange(3.0),
        tuple(names),
        tuple(texts),
        values,
        tuple(texts),
        parameters=gains,
        provenance=origin,
    )


@pytest.mark.parametrize("ending", FORMATS)
def test_names_units_and_texts_come_back(tmp_path, ending):
    result = named(*(odd for odd in ODD if odd not in REJECTED.get(ending, ())))
    back = read(result.save(tmp_path / f"out{ending}"))
    order = [back.columns.index(name) for name in result.columns]
    assert len(back.columns) == len(result.columns)
    assert np.array_equal(back.values[:, order], result.values)
    assert [back.units[i] for i in order] == list(result.units)
    assert [back.descriptions[i] for i in order] == list(result.descriptions)
    assert sorted(back.parameters.columns) == sorted(result.parameters.columns)
    assert (back.system, back.provenance) == (result.system, result.provenance)


@pytest.mark.parametrize("ending", REJECTED)
def test_names_that_cannot_be_held_are_rejected(tmp_path, ending):
    for odd in REJECTED[ending]:
        with pytest.raises(ResultsError, match="cannot be written"):
            named(odd).save(tmp_path / f"out{ending}")


@pytest.mark.parametrize("ending", FORMATS)
def test_the_reason_of_an_early_end_comes_back_in_one_line(tmp_path, ending):
    message = "a.b: " + "".join(f"one{odd}two" for odd in ODD if odd != "\0")
    back = read(replace(named("y"), complete=False, message=message).save(tmp_path / f"x{ending}"))
    assert not back.complete
    assert back.message.split() == message.split()


@pytest.mark.parametrize("where", ["units", "descriptions", "system", "message"])
def test_a_text_is_not_cut_at_a_nul(tmp_path, where):
    cut = ("x\0y",) * 6 if where in ("units", "descriptions") else "x\0y"
    with pytest.raises(ResultsError, match="contains a NUL character"):
        replace(named("y"), **{where: cut}).save(tmp_path / "out.nc")


def test_every_other_reader_finds_as_many_names_as_columns(tmp_path):
    result = named(*ODD)
    path = result.save(tmp_path / "out.csv")
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert tuple(head[1:]) == result.columns
    assert [len(row) for row in rows] == [len(head)] * 3


def test_a_table_of_runs_has_a_line_for_each(tmp_path):
    labels = ["plain", *(f"x{odd}y" for odd in ODD if odd != "\\n")]  # that is what \n becomes
    metrics = {(f"error{odd}", f"m{odd}"): dict.fromkeys(labels, 1.5) for odd in ODD}
    write_csv(metrics, labels, tmp_path / "table.csv")
    columns, found = read_csv(tmp_path / "table.csv")
    assert len(found) == len(set(found)) == len(labels)
    assert len((tmp_path / "table.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(labels)
    assert all(list(column.values()) == [1.5] * len(labels) for column in columns.values())
    shown = table(metrics, labels)
    lines, height = [*shown.splitlines(), ""], 3 + len(labels) + 1  # an empty line between blocks
    assert len(lines) % height == 0
    assert not any(lines[height - 1 :: height])
    blocks = [lines[k : k + height - 1] for k in range(0, len(lines), height)]
    begin = max(len(one_line(label)) for label in labels)
    for block in blocks:
        assert [line[:begin].rstrip() for line in block[3:]] == list(map(one_line, labels))
    for rows in zip(*(block[3:] for block in blocks), strict=True):
        assert sum(row[begin:].split().count("1.500") for row in rows) == len(metrics)
    assert not set(CONTROLS) & set(shown.replace("\n", ""))


def test_the_end_of_a_wide_table_with_letters_of_several_bytes_is_found(tmp_path):
    """The last 10 000 bytes begin amid a letter."""
    names = tuple(f"a.{'ä' * 999}{i}" for i in range(20))
    wide = Result("s", np.zeros(1), names, ("",) * 20, np.zeros((1, 20)))
    for message in ("x", "xy"):
        path = replace(wide, complete=False, message=message).save(tmp_path / "out.csv")
        assert read(path).message == message
