# SPDX-License-Identifier: BSD-2-Clause
"""`harness new sensor` and `harness new plant`: the folders run as they are, and the models obey
their equations, by an independent generator and by matrix exponentials.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from harness import run
from harness.cli.app import main
from harness.mission import library
from harness.results.requirements import findings
from harness.results.verdict import Verdict
from harness.ssp.library import load
from tests.close import close
from tests.reference import random_numbers


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a new sensor and a new plant, made and built by the command lines."""
    place = tmp_path_factory.mktemp("added")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for kind in ("sensor", "plant"):
            assert main(["new", kind, f"mine_{kind}"]) == 0
            assert main(["build", f"mine_{kind}"]) == 0
    yield place
    library._named.clear()  # a folder that is named stays among the missions of the process


def test_the_sensor_adds_one_bias_and_the_noise_of_each_sample(folder):
    """r_meas = r + b + sigma_r z_0, v_meas = v + sigma_v z_3, of the states before the step."""
    result = run(folder / "mine_sensor", set={"sensor.seed": 7}, stop=10.0)
    sigma = {n: result.parameter(f"sensor.sigma_{n}") for n in "rvb"}
    assert min(sigma.values()) > 0
    bias = sigma["b"] * random_numbers.normals(7, 20, 0, 3, once=1)
    noise = np.array([random_numbers.normals(7, 20, n, 6) for n in range(100)])
    before = slice(0, 100)  # sample n is taken in the step that begins at n sample_period
    r = result["sensor.r_meas_N"][1:] - result["servicer.r_SN_N"][before]
    v = result["sensor.v_meas_N"][1:] - result["servicer.v_SN_N"][before]
    close(r, bias + sigma["r"] * noise[:, :3], rel=1e-15, of=8e6)
    close(v, sigma["v"] * noise[:, 3:], rel=1e-15, of=8e3)


def test_the_software_reads_the_sensor_and_the_monitor_the_truth(folder):
    with load(folder / "mine_sensor") as system:
        sources = {
            f"{c.target.component}.{c.target.variable}": c.source.component
            for c in system.connections
        }
    for name in ("r_SN_N[1]", "v_SN_N[3]"):
        assert sources[f"guidance.{name}"] == sources[f"controller.{name}"] == "sensor"
        assert sources[f"monitor.{name}"] == sources[f"sensor.{name}"] == "servicer"


def test_the_plant_moves_by_the_exponential_of_its_matrix(folder):
    """With F constant over a step, s and ds follow a linear system."""
    result = run(folder / "mine_plant", stop=30.0)
    m, w, zeta = (result.parameter(f"plant.{n}") for n in ("m", "omega", "zeta"))
    force, mass = result["propulsion.F_S"][1:], result["servicer.mass"][:-1]
    assert np.ptp(mass) == 0
    assert np.abs(force).max() > 0.1
    both = 1 + m / mass[0]
    A = np.array([[0, 1, 0], [-both * w * w, -both * 2 * zeta * w, -1 / mass[0]], [0, 0, 0]])
    transition = expm(0.1 * A)[:2]
    x, found = np.zeros((2, 3)), []
    for F in force:
        x = transition @ np.vstack([x, F])
        found.append(x)
    s, ds = np.array(found).transpose(1, 0, 2)
    assert np.abs(s).max() > 1e-3
    # 300 steps of Runge-Kutta, each with an error of (omega h)^5 / 120
    close(result["plant.s_S"][1:], s, rel=1e-7)
    close(result["plant.F_slosh_S"][1:], m * (w * w * s + 2 * zeta * w * ds), rel=1e-7)


def test_the_servicer_feels_the_plant(folder):
    """Its acceleration, beside the same run without the spring: the force of the mass."""
    slosh = run(folder / "mine_plant", stop=2.0, set={"plant.zeta": 0.02})
    rigid = run(folder / "mine_plant", stop=2.0, set={"plant.m": 1e-9})
    felt = slosh["servicer.v_SN_N"] - rigid["servicer.v_SN_N"]
    assert 1e-7 < np.abs(felt[-1]).max() < 1e-2


@pytest.mark.long
@pytest.mark.parametrize("kind", ["sensor", "plant"])
def test_unedited_it_meets_every_requirement_of_a_clear_approach(folder, kind):
    result = run(folder / f"mine_{kind}", params="clear", every=10)
    assert {f.verdict for f in findings(result)} == {Verdict.MET}


def test_the_readme_names_the_commands_that_were_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "plant", "tank"]) == 0
    printed = [line.strip() for line in capsys.readouterr().out.splitlines()[1:]]
    assert printed == ["harness build tank", "harness run tank --params clear -o tank/tank.nc"]
    page = (tmp_path / "tank/README.md").read_text()
    assert all(f"    {command}\n" in page for command in printed)
    assert "tank.fmu" in (tmp_path / "tank/system.toml").read_text()
