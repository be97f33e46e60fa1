# SPDX-License-Identifier: BSD-2-Clause
"""Metrics and names that a campaign cannot have are rejected before it starts; what only a run can
show is a missing value that is reported, and never a success or a failure.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import campaign, run
from harness.cli.app import main
from harness.errors import RequirementError, StructureError
from harness.studies.campaign import metrics

MASS = {"servicer.mass_0": {"uniform": {"low": 90.0, "high": 110.0}}}


def table(**more):
    return {"system": "sync_approach", "fixed": {"stop": 2.0}, "runs": 3, "factors": MASS, **more}


def rejected(tmp_path, **more):
    """The problems of a campaign that does not start."""
    with pytest.raises(StructureError) as caught:
        campaign(table(**more), tmp_path / "c.zarr", workers=0)
    assert not (tmp_path / "c.zarr").exists()
    return [line.removeprefix("campaign: ") for line in str(caught.value).splitlines()]


NOBODY_HAS = {
    "servicer.r_SN_N": "is an array of 21 x 3, not one number; reduce it with last() or max()",
    "norm(servicer.r_SN_N)": "is an array of 21, not one number; reduce it with last() or max()",
    "at(norm(servicer.r_SN_N), 2.1 s)": "at(): expected a time from 0 to 2 s, got 2.1 s",
    "servicer.r_SN_N[4]": "there is no variable servicer.r_SN_N[4]",
    "first(servicer.r_SN_N - target.r_TN_N)[4]": "has 3 elements",
    "max()": "",
    "last(max(norm(servicer.r_SN_N)))": "last(): `max(norm(servicer.r_SN_N))` has no rows",
    "servicer.r_SN_N < 3": "is an array of 21 x 3, not one number; reduce it with last() or max()",
    "parameter(servicer.mass_1)": "mass_1",
}


ALONE = ["max()", "servicer.r_SN_N[4]"]
"""Metrics whose text alone is wrong: others are looked at after these."""


@pytest.mark.parametrize(
    "texts", [*([text] for text in ALONE), [t for t in NOBODY_HAS if t not in ALONE]], ids=len
)
def test_metrics_that_no_run_can_have_are_rejected(tmp_path, texts):
    lines = rejected(tmp_path, metrics={f"odd{k}": text for k, text in enumerate(texts)})
    for k, (line, text) in enumerate(zip(sorted(lines), texts, strict=True)):
        assert line.startswith(f"metrics.odd{k}: ")
        assert NOBODY_HAS[text] in line


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("norm(servicer.r_SN_N)", "is not a condition; write one like "),
        ("at(norm(servicer.r_SN_N), 2.1 s) > 0", "at(): expected a time from 0 to 2 s, got 2.1 s"),
        ("parameter(servicer.mass_1) > 0", "mass_1"),
    ],
)
def test_a_success_that_no_run_can_have_is_rejected(tmp_path, text, why):
    (line,) = rejected(tmp_path, success=text)
    assert line.startswith("success: ")
    assert why in line


def test_the_last_row_of_a_thinned_run_counts(tmp_path):
    """20 macro steps, every 8th recorded: rows 0, 8, 16 and, because it is the last one, 20."""
    (line,) = rejected(tmp_path, every=8, metrics={"odd": "at(time, 2.1 s)"})
    assert line.endswith("at(): expected a time from 0 to 2 s, got 2.1 s")
    found = campaign(
        table(every=8, metrics={"end": "at(time, 2 s)"}), tmp_path / "c.zarr", workers=0
    )
    assert found.store.array("end").tolist() == [2.0] * 3


def test_a_metric_of_another_kind_of_system_is_rejected(tmp_path):
    (line,) = rejected(tmp_path, system="space_robot", factors={}, metrics={"cost": "delta-v"})
    assert line.startswith("metrics.cost: the system lacks what the metric needs: ")


def test_a_metric_that_depends_on_the_run_is_a_missing_value_and_a_line(tmp_path, capsys):
    """Rows 0 to 20 after 2 s, to 10 after 1 s."""
    stops = {"stop": {"list": [2.0, 1.0]}}
    given = table(runs=1, factors=stops, metrics={"late": "at(norm(servicer.r_SN_N), 1.5 s)"})
    done = campaign(given, tmp_path / "c.zarr", workers=0)
    late = done.store.array("late")
    again = run("sync_approach", stop=2.0)
    assert late[0] == np.linalg.norm(again["servicer.r_SN_N"], axis=-1)[15]
    assert np.isnan(late[1])
    assert done.store.array("status").tolist() == [1, 1]
    line = (
        "late: no value in 1 of 2 runs, first run 1 (at(): expected a time from 0 to 1 s, got 1.5 s"
    )
    assert line in done.summary()


def test_a_success_that_one_structure_has_not_is_rejected(tmp_path):
    stops = {"stop": {"list": [2.0, 1.0]}}
    (line,) = rejected(tmp_path, factors=stops, success="at(norm(servicer.r_SN_N), 1.5 s) > 0")
    assert line == "success: at(): expected a time from 0 to 1 s, got 1.5 s"


def test_a_success_that_a_run_cannot_state_is_an_error_and_never_0_per_cent(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        "def ok(result):\n"
        "    if result.parameter('servicer.mass_0') > 100:\n"
        "        raise RuntimeError('too\\nheavy')\n"
        "    return True\n"
        "def never(result):\n"
        "    return float('nan')\n"
    )
    weights = {"servicer.mass_0": {"list": [95.0, 105.0, 99.0]}}
    given = table(runs=1, factors=weights, success=f"{tmp_path}/mine.py:ok")
    with pytest.raises(RequirementError) as caught:
        campaign(given, tmp_path / "c.zarr", workers=0)
    line = "success: cannot be evaluated in 1 of 3 runs, first run 1 (RuntimeError: too heavy)"
    assert str(caught.value) == line
    found = caught.value.partial
    assert "\nsuccess: 2 of 2, 100.0 %" in found.summary()
    assert f"\n{line}" in found.summary()
    text = (
        f'system = "sync_approach"\nruns = 2\nsuccess = "{tmp_path}/mine.py:never"\n'
        "[fixed]\nstop = 1.0\n"
    )
    (tmp_path / "c.toml").write_text(text)
    status = main(["campaign", "c.toml", "-o", "d.zarr", "--workers", "0"])
    output = capsys.readouterr()
    assert status == 1
    assert " 0.0 %" not in output.out
    problem = "success: cannot be evaluated in 2 of 2 runs, first run 0"
    assert problem in output.out
    assert output.err == f"harness: {problem}\n"
    assert main(["report", "d.zarr", "-o", "d.html"]) == 0


def test_a_function_that_gives_no_number_costs_its_own_column_only(tmp_path):
    (tmp_path / "mine.py").write_text(
        "def text(result):\n    return 'a text'\n"
        "def nothing(result):\n    return None\n"
        "def rows(result):\n    return result.time\n"
        "def fine(result):\n    return len(result.time)\n"
    )
    names = ("text", "nothing", "rows", "fine")
    given = table(metrics={name: f"{tmp_path}/mine.py:{name}" for name in names})
    done = campaign(given, tmp_path / "c.zarr", workers=0)
    assert done.store.array("fine").tolist() == [21.0] * 3
    for name, why in (
        ("text", "is 'a text', not a number"),
        ("nothing", "is None, not a number"),
        ("rows", "is an array of 21, not one number; reduce it with last() or max()"),
    ):
        assert np.isnan(done.store.array(name)).all()
        assert f"\n{name}: no value in 3 of 3 runs, first run 0 ({why})" in done.summary()


HELD_BY_NOBODY = (
    "status", "message", "end_time", "last", "column", "column_units", "time", "percentile",
    "run", "success", "servicer.mass_0", "guidance.range", "guidance.range_band",
    "servicer.r_SN_N_band", "guidance.range_element", "", ".", "..", "a/b", "/", "a\\b", "a\nb",
    "__a", "zarr.json", "n" * 300,
)  # fmt: skip


def test_names_that_the_dataset_cannot_hold_are_rejected(tmp_path):
    record = {"histories": ["guidance.range"], "bands": ["servicer.r_SN_N"]}
    names = dict.fromkeys(HELD_BY_NOBODY, "last(guidance.range)")
    lines = rejected(tmp_path, metrics=names, record=record)
    assert len(lines) == len(HELD_BY_NOBODY)
    assert all(line.startswith("metrics.") for line in lines)


def test_every_other_name_is_held(tmp_path):
    names = ["a b", "ä", "x.y", "-", "last row", "run_1", "c", "100 %"]
    given = table(metrics={name: f"last(guidance.range) + {k}" for k, name in enumerate(names)})
    done = campaign(given, tmp_path / "c.zarr", workers=0)
    first = done.store.array(names[0])
    assert np.isfinite(first).all()
    for k, name in enumerate(names):
        assert done.store.array(name) == pytest.approx(first + k), name
        assert done.data[name].dims == ("run",), name
    assert set(done.store.names("metric")) == {*names, "success"}


def test_a_seed_is_not_a_factor_too_and_is_given_once(tmp_path):
    noise = "target.omega_TN_T_0"
    assert rejected(tmp_path, seeds=["servicer.mass_0"]) == [
        "seeds.servicer.mass_0: is also in [factors] or twice in seeds; remove one of the entries"
    ]
    twice = rejected(tmp_path, seeds=[noise, noise])
    assert (
        f"seeds.{noise}: is also in [factors] or twice in seeds; remove one of the entries" in twice
    )


def test_two_metrics_whose_names_are_one_in_expressions_are_rejected(tmp_path):
    """Python reads the ligature and the two letters as one name."""
    metrics = {"\ufb01nal": "last(guidance.range)", "final": "max(guidance.range)"}
    found = rejected(tmp_path, metrics=metrics)
    assert [line for line in found if "normal form NFKC" in line]


def test_the_error_of_a_metric_is_a_line_of_200_characters():
    def wordy(_):
        raise ValueError("no\n  such thing " + "x" * 300)

    found, reason = metrics.value(wordy, None)
    assert np.isnan(found)
    assert reason == "no such thing " + "x" * 186
