# SPDX-License-Identifier: BSD-2-Clause
"""Names of modes: in descriptions of FMUs, files, figures and the head of a page."""

from __future__ import annotations

import re
from dataclasses import replace

from harness import read, run
from harness.figures.choice import figure_of
from harness.figures.plots import paint
from harness.files import paths
from harness.report.run import headline
from harness.system.interface import read_interface
from ssp.shared.relative_motion import position_error, range_, relative_speed

LISTED = re.compile(r"\b0\W+[A-Za-z].*[,;] 1\W+[A-Za-z]")
"""A description that lists what 0 and 1 mean, in any grammar."""


def test_every_mode_of_every_fmu_has_names_by_number():
    found = {}
    for component, path in paths.fmus().items():
        for name, variable in read_interface(path).variables.items():
            if variable.causality != "parameter" and LISTED.search(variable.description):
                found[f"{component}.{name}"] = variable.modes.split("|")
    assert all(map(any, found.values())), [name for name, names in found.items() if not any(names)]
    phases = found["mission_manager.phase"]
    assert len(phases) == 15
    assert [phases[k] for k in (1, 3, 6)] == ["hold 1", "hold 2", "hold 3"]
    assert [phases[k] for k in (4, 11)] == ["fly-around", "back-off"]
    assert found["docking_mechanism.phase"][2] == "soft capture"
    assert found["pursuit_guidance.mode"] == ["coast", "align", "burn"]
    assert len(found) >= 15


def test_names_of_modes_survive_every_format(tmp_path):
    result = run("relay_approach", stop=1.0)
    assert result.mode_names("guidance.mode") == ("coast", "align", "burn")
    assert result.mode("guidance.mode", 2.0) == "burn"
    assert result.mode("guidance.mode", 7.0) == "7"
    assert not result.mode_names("guidance.range")
    for ending in ("nc", "csv"):
        again = read(result.save(tmp_path / f"r.{ending}"))
        assert again.modes == result.modes, ending


def test_the_axis_of_a_mode_shows_its_names():
    result = run("relay_approach", stop=1.0)
    axes = paint(figure_of(result, ["guidance.mode"]), result).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["coast", "align", "burn"]


def test_the_head_of_a_page_names_the_modes_of_the_last_row():
    result = run("servicing_mission", stop=1.0)
    values = result.values.copy()
    values[-1, result.columns.index("mechanism.phase")] = 2
    values[-1, result.columns.index("manager.phase")] = 3
    _, ended = headline(replace(result, values=values))
    assert ended.startswith("Ended at 1 s with phase hold 2, latch soft capture, attempt 0; ")


def test_the_head_of_a_page_states_three_metrics_of_the_last_row():
    result = run("sync_approach", stop=2.0)
    last = [value(result)[-1] for value in (range_, relative_speed, position_error)]
    stated = "with range {:.4g} m, speed {:.4g} m/s, position error {:.4g} m; ".format(*last)
    assert headline(result)[1].startswith(f"Ended at 2 s {stated}")
