# SPDX-License-Identifier: BSD-2-Clause
"""A system of the project under the master: bits, columns, rows, parameter sets, bad input from the
command line.
"""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from harness import load, run
from harness.cli.app import main
from harness.files import paths
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.system.interface import read_interface
from tests.each import some

pytestmark = pytest.mark.skipif(
    "sync_approach" not in paths.systems(), reason="the project has not been built"
)

SPAN = 60.0
"""A minute is 600 macro steps, with the attitude control from its second half on."""


@pytest.fixture
def early():
    """Parameters that start the attitude control at 30 s."""
    return {"controller.t_att": 30.0, "servicer.t_att": 30.0, "servicer.M_dist_S.start": 30.0}


def same_bits(a, b):
    return (
        a.columns == b.columns
        and a.time.tobytes() == b.time.tobytes()
        and a.values.tobytes() == b.values.tobytes()
    )


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_executors_agree_bit_for_bit(early, algorithm):
    a, b = (
        run("sync_approach", stop=SPAN, set=early, algorithm=algorithm, executor=e)
        for e in ("c", "python")
    )
    assert same_bits(a, b)
    assert np.abs(a["servicer.wheel_speed"][-1]).max() > 0  # the attitude control has been at work


def test_a_run_repeats_to_the_bit(early):
    assert same_bits(
        run("sync_approach", stop=SPAN, set=early), run("sync_approach", stop=SPAN, set=early)
    )


def test_rows_go_from_zero_to_the_stop_time_with_every_output_of_every_component(tmp_path):
    status = main(["run", "sync_approach", "--stop", "2", "-q", "-o", str(tmp_path / "x.csv")])
    with (tmp_path / "x.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert status == 0
    assert [float(row[0]) for row in rows] == [k * 0.1 for k in range(21)]
    with load("sync_approach") as system:
        expected = [
            f"{c.name}.{name}"
            for c in system.components
            for name in read_interface(c.fmu).outputs()
        ]
    assert header == ["time", *expected]


def test_the_first_row_holds_propagated_values():
    first = run("sync_approach", stop=0.1)
    assert first["guidance.range"][0] == pytest.approx(
        20.0, abs=1e-6
    )  # |rho_0_H|, through both plants and the guidance
    force, mass = np.linalg.norm(first["controller.F_cmd_S"][0]), first["controller.m_hat"][0]
    assert mass == 95.0
    assert force > 0
    assert first["propulsion.F_S"][0] == pytest.approx(first["controller.F_cmd_S"][0])
    assert first["servicer.mass"][0] == 100.0


def test_a_restored_system_has_the_same_future(early):
    with (
        load("sync_approach") as system,
        Simulation(apply(system, set=early, stop=SPAN)) as simulation,
    ):
        simulation.advance(to=350)
        snapshot = simulation.save()
        simulation.advance()
        first = simulation.result().values.copy()
        simulation.restore(snapshot)
        simulation.advance()
        assert simulation.result().values.tobytes() == first.tobytes()
        simulation.free(snapshot)


def test_the_order_of_components_does_not_matter_to_jacobi(early):
    with load("sync_approach") as system:
        changed = apply(system, set=early, stop=SPAN, algorithm="jacobi")
        forward = run(changed)
        backward = run(replace(changed, components=changed.components[::-1]))
    for column in forward.columns:
        assert forward[column].tobytes() == backward[column].tobytes()


def test_every_parameter_set_runs():
    with load("sync_approach") as system:
        names = ["default", *(s.name for s in system.sets)]
    finals = {
        name: run("sync_approach", params=name, stop=5.0)["controller.m_hat"][-1] for name in names
    }
    assert len(set(finals.values())) > 1


# ---- bad input


TRIANGLE = (
    "must satisfy the triangle inequality (no principal moment above the sum of the other two)"
)


@pytest.mark.parametrize(
    ("setting", "rules"),
    [
        ("servicer.mass_0=0", ["must be > 0"]),
        (
            "servicer.J_S=[[-1, 0, 0], [0, 250, 0], [0, 0, 150]]",
            # 12 kg m2 belong to the wheels
            ["must be positive definite", TRIANGLE, "J_S - A_w = -13 must be positive definite"],
        ),
        ("target.J_T=[[100, 0, 0], [0, 150, 0], [0, 0, 300]]", [TRIANGLE]),
        ("target.e=1", ["must be in [0, 1)"]),
        ("target.max_step=0", ["must be > 0"]),
    ],
)
def test_a_parameter_beyond_physics_is_rejected_a_line_per_rule(capsys, tmp_path, setting, rules):
    output = tmp_path / "x.csv"
    command = ["run", "sync_approach", "--stop", "1", "--set", setting, "-o", str(output)]
    assert main(command) == 2  # the option is at fault
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [f"harness: --set {setting}: {rule}" for rule in rules]
    assert not output.exists()


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        (
            "servicer.mas_0=1",
            "harness: --set servicer.mas_0: there is no such variable (close: mass_0",
        ),
        ("servicer.mass_0=nan", "harness: --set servicer.mass_0: it must not be NaN"),
        (
            "servicer.J_S=[1, 2, 3]",
            "harness: --set servicer.J_S: expected 3 x 3 elements, got 3 elements",
        ),
    ],
)
def test_a_mistaken_parameter_is_wrong_use(capsys, setting, line):
    assert main(["run", "sync_approach", "--set", setting]) == 2
    (reported,) = capsys.readouterr().err.splitlines()
    assert reported.startswith(line)


@pytest.mark.parametrize("name", some(sorted(paths.systems()), 5))
def test_every_system_of_the_project_passes_its_check(capsys, name):
    assert main(["check", name]) == 0, capsys.readouterr().err
