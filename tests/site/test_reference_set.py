# SPDX-License-Identifier: BSD-2-Clause
"""The archive of reference systems for makers of tools, and the script in it that compares."""

from __future__ import annotations

import csv
import re
import shutil
import zipfile

import numpy as np
import pytest

from harness import run
from harness.files import paths
from tests.site.scripts import script

SYSTEM = "space_robot"
ENDINGS = ("c", "csv", "fmu")
specimens = script("specimens")


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The archive of one system; the same file represents the twin of FMI 3.0 here."""
    folder = tmp_path_factory.mktemp("dist")
    for name in ("ssp", "specimens"):
        (folder / name).mkdir()
    for name in script("specimens").TRACES:
        (folder / "specimens" / f"{name}.fmu").write_bytes(b"an FMU")
    content = paths.systems()[SYSTEM].read_bytes()
    for ending in (".ssp", ".fmi3.ssp"):
        (folder / "ssp" / f"{SYSTEM}{ending}").write_bytes(content)
    archive = script("reference_set").write(folder, folder / "specimens")
    with zipfile.ZipFile(archive) as files:
        files.extractall(folder / "set")
    return folder / "set"


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return head, np.array(rows, dtype=float)


def compared(unpacked, given, capsys):
    """Return the exit status of the script, and what it prints."""
    trace = unpacked / "traces" / f"{SYSTEM}.csv"
    status = script("compare").main([str(trace), str(given)])
    return status, capsys.readouterr().out


def test_the_archive_has_systems_traces_and_reasons(unpacked):
    names = {p.relative_to(unpacked).as_posix() for p in unpacked.rglob("*") if p.is_file()}
    assert names == {
        "README.txt", "compare.py", f"traces/{SYSTEM}.csv", "traces/tolerances.csv",
        *(f"{folder}/{SYSTEM}.ssp" for folder in ("ssp1", "ssp2", "ssp2-fmi3")),
        *(f"specimens/{name}.{ending}" for name in specimens.TRACES for ending in ENDINGS),
        *(f"specimens/{name}" for name in (*specimens.HEADERS, "tolerances.csv")),
    }  # fmt: skip
    head, _ = rows_of(unpacked / "traces" / f"{SYSTEM}.csv")
    with (unpacked / "traces/tolerances.csv").open(encoding="utf-8", newline="") as file:
        limits = list(csv.DictReader(file))
    assert [row["variable"] for row in limits] == head[1:]
    assert all(row["reason"] and float(row["tolerance"]) >= 0 for row in limits)


def test_a_variable_without_a_tolerance_is_named(unpacked, tmp_path, capsys):
    for name in (f"{SYSTEM}.csv", "tolerances.csv"):
        shutil.copy(unpacked / "traces" / name, tmp_path)
    head, _ = rows_of(tmp_path / f"{SYSTEM}.csv")
    limits = tmp_path / "tolerances.csv"
    lines = limits.read_text(encoding="utf-8").splitlines(keepends=True)
    limits.write_text("".join(x for x in lines if f"{head[2]}," not in x), encoding="utf-8")
    trace = str(tmp_path / f"{SYSTEM}.csv")
    assert script("compare").main([trace, trace]) == 2
    assert capsys.readouterr().err == f"tolerances.csv: has no row for {SYSTEM}, {head[2]}\n"


def test_rows_of_a_specimen_are_compared_without_tolerance(unpacked, tmp_path, capsys):
    trace = unpacked / "specimens" / "event.csv"
    assert script("compare").main([str(trace), str(trace)]) == 0
    head, rows = rows_of(trace)
    rows[5, 1] += 1e-12
    spoiled = tmp_path / "rows.csv"
    with spoiled.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([head, *rows.tolist()])
    assert script("compare").main([str(trace), str(spoiled)]) == 1
    assert "level differs" in capsys.readouterr().out


@pytest.mark.long
def test_our_jacobi_run_agrees_in_the_style_of_another_tool(unpacked, tmp_path, capsys):
    """Names with a prefix and other separators, twelve digits, an instant twice."""
    head, expected = rows_of(unpacked / "traces" / f"{SYSTEM}.csv")
    result = run(SYSTEM, algorithm="jacobi", stop=float(expected[-1, 0]))
    named = [f"model.root.{name.replace('.', '::')}" for name in head[1:]]
    rows = [("time", *named)]
    for k, t in enumerate(result.time):
        values = (t, *(result[name][k] for name in head[1:]))
        rows += 2 * [tuple(f"{x:.12g}" for x in values)]

    def written(name, rows):
        with (tmp_path / name).open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(rows)
        return tmp_path / name

    status, text = compared(unpacked, written("rows.csv", rows), capsys)
    assert (status, text.strip()) == (0, f"{len(named)} of {len(named)} variables agree")
    spoiled = [rows[0], *((t, *(f"{1.001 * float(x):.12g}" for x in v)) for t, *v in rows[1:])]
    status, text = compared(unpacked, written("spoiled.csv", spoiled), capsys)
    assert status == 1
    assert "differs by" in text
    status, text = compared(unpacked, written("short.csv", [row[:3] for row in rows]), capsys)
    assert status == 1
    assert text.count("is missing") == len(named) - 2
    status, text = compared(unpacked, written("early.csv", rows[:-2]), capsys)
    assert status == 1
    assert re.search(r"^time compared up to t = \S+ s, the trace ends at \S+ s$", text, re.M)
    assert compared(unpacked, tmp_path / "none.csv", capsys)[0] == 2
