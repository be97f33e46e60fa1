# SPDX-License-Identifier: BSD-2-Clause
"""A deviation of an FMU from the standard is reported once by every command that uses it, and names
that control a terminal reach neither it nor a table.
"""

from __future__ import annotations

import logging
import re
import tomllib
import zipfile

import pytest

from harness.cli.app import main
from harness.master.messages import logged_once
from harness.spelling import one_line
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.compare import table, write_csv

TOML = """
name = "odd"
[experiment]
stop = 3.0
step = 1.0
[components]
a = "odd"
b = "odd"
count = "counter"
[connections]
"a.u" = "count.n"
"b.u" = "a.y"
"""
CAMPAIGN = """
system = "odd.ssp"
[factors]
"swap.a" = {list = ["odd.fmu", "gain.fmu"]}
"a.k" = {list = [1.0, 2.0, 3.0]}
[metrics]
end = "last(b.y)"
"""


@pytest.fixture
def folder(fmus, tmp_path, monkeypatch):
    """With odd.fmu, which has no list of initial unknowns, and a system that has it twice."""
    with zipfile.ZipFile(fmus["gain"]) as good, zipfile.ZipFile(tmp_path / "odd.fmu", "w") as odd:
        for entry in good.infolist():
            text = good.read(entry)
            if entry.filename == "modelDescription.xml":
                text, count = re.subn(rb"<InitialUnknowns>.*</InitialUnknowns>", b"", text)
                assert count == 1
            odd.writestr(entry, text)
    system = system_of(tomllib.loads(TOML), {**fmus, "odd": tmp_path / "odd.fmu"})
    write_ssp(system, tmp_path / "odd.ssp")
    (tmp_path / "gain.fmu").write_bytes(fmus["gain"].read_bytes())
    (tmp_path / "c.toml").write_text(CAMPAIGN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


COMMANDS = {
    "run": ("run", "odd.ssp", "-o", "x.csv"),
    "compare": ("compare", "odd.ssp", "--vary", "a.k=1,2,3", "-o", "out", "--no-figures"),
    "export": ("export", "odd.ssp", "copy.ssp"),
    "linearize": ("linearize", "odd.fmu", "-o", "x.npz", "--step", "1"),
    "campaign": ("campaign", "c.toml", "-o", "x.zarr", "--workers", "0"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_warning_about_an_fmu_is_reported_in_one_line(folder, caplog, command):
    assert main(COMMANDS[command]) == 0
    assert caplog.messages == ["odd.fmu: ModelStructure/InitialUnknowns: must list y"]


def test_a_warning_of_every_variant_of_a_comparison_is_reported_once(folder, caplog):
    """A sample period that is no multiple of the step, in all three runs."""
    from tests.harness.third_party_fmu import Model, build, p, u, y

    period = p("sample_period", 0.7, "s")
    build(Model("late", [u("u"), y("y"), p("k", 1.0), period], "y = k * u;"), folder)
    swap = ("--swap", "b=late.fmu")
    assert main([*COMMANDS["compare"], *swap]) == 0
    assert sum("is not a multiple" in message for message in caplog.messages) == 1


def test_notes_are_reported_also_if_the_block_fails(caplog):
    with pytest.raises(ZeroDivisionError), logged_once():
        for _ in range(3):
            logging.getLogger("harness").warning("a %s note", "short")
        raise ZeroDivisionError
    assert caplog.messages == ["a short note"]


# ---- names that control a terminal

ODD = "\x1b[31mred\x07\u202e\nnew\tline"
SHOWN = "\\x1b[31mred\\x07\\u202e\\nnew\\tline"


def test_one_line_retains_what_can_be_shown():
    assert one_line(ODD) == SHOWN
    assert one_line("a = 1.5 µs, ok") == "a = 1.5 µs, ok"


def test_tables_hold_no_control_characters(tmp_path):
    metrics = {("end", "m"): {ODD: 1.0, "plain": 2.0}}
    lines = table(metrics, [ODD, "plain"]).splitlines()
    assert len(lines) == 5
    assert lines[3].startswith(f"{SHOWN}  ")
    write_csv(metrics, [ODD, "plain"], tmp_path / "x.csv")
    text = (tmp_path / "x.csv").read_text()
    assert text.splitlines() == ["run,end [m]", f"{SHOWN},1.0", "plain,2.0"]


def test_a_comparison_of_odd_file_names_leaves_the_terminal_alone(folder, capfd):
    odd = folder / "od\x1b[2Jd.fmu"
    odd.write_bytes((folder / "gain.fmu").read_bytes())
    arguments = ["compare", "odd.ssp", "--swap", f"a=gain.fmu,{odd.name}", "-o", "out"]
    assert main([*arguments, "--no-figures"]) == 0
    out, err = capfd.readouterr()
    assert "\x1b" not in out + err
    assert "od\\x1b[2Jd" in out
    assert "\x1b" not in (folder / "out" / "comparison.csv").read_text()


def test_the_summary_of_a_campaign_shows_messages_on_one_line_each(folder, capfd):
    from tests.harness.third_party_fmu import Model, build, p, u, y

    states = 'return fail(3, "hot\\033[31m\\ncold");'
    build(Model("bad", [u("u"), y("y"), p("k", 1.0)], "y = k * u;", states), folder)
    campaign = CAMPAIGN.replace('"gain.fmu"', '"bad.fmu"')
    (folder / "c.toml").write_text(campaign)
    assert main(COMMANDS["campaign"]) == 0
    out, err = capfd.readouterr()
    assert "\x1b" not in out + err
    assert len(re.findall(r"^failed: run \d.*: a: .*hot\\x1b\[31m cold", out, re.M)) == 3
