# SPDX-License-Identifier: BSD-2-Clause
"""The system arch_rendezvous: the flight of the benchmark's equations, the eleven published
verdicts, margins of the monitor against the recorded flight, and a campaign over all starts.

The equations are integrated here by matrix exponentials in the benchmark's units (m, min, kg).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from harness import campaign as campaign_of
from harness import run
from harness.claims import Verdict
from harness.claims.arch_comp_spre import PAPERS
from harness.claims.report import report
from harness.files import paths
from harness.system.tables import read_toml
from harness.validation.rendezvous import INSTANCES, NEVER, START, campaign

N = np.sqrt(3.986e14 * 3600 / 42164e3**3)
FREE = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [3 * N**2, 0, 0, 2 * N], [0, 0, -2 * N, 0]])
PUSH = np.array([[0, 0], [0, 0], [1 / 500, 0], [0, 1 / 500]])
K1 = [[-28.8287, 0.1005, -1449.9754, 0.0046], [-0.087, -33.2562, 0.00462, -1451.5013]]
K2 = [[-288.0288, 0.1312, -9614.9898, 0.0], [-0.1312, -288.0, 0.0, -9614.9883]]
MONITOR_ALONE = {"monitor.passive_time": 0}


@cache
def flight(name):
    """Every tenth second; the monitor's rules are judged at every step all the same."""
    return run("arch_rendezvous", params=name, every=50, set=MONITOR_ALONE)


def benchmark(abort_min, dt=0.005):
    """Times [min] and states, thrust in continuous time."""
    flows = [expm((FREE + PUSH @ np.array(K)) * dt) for K in (K1, K2)] + [expm(FREE * dt)]
    s, attempt, rows = np.array((-900.0, -400.0, 0, 0)), False, []
    for k in range(round(300 / dt) + 1):
        attempt |= s[0] >= -100
        rows.append(s)
        s = flows[2 if k * dt >= abort_min - 1e-9 else int(attempt)] @ s
    return dt * np.arange(len(rows)), np.array(rows)


@pytest.mark.parametrize("name", ["SRNA01", "SRA01", "SRU01"])
def test_flight_is_that_of_the_benchmark(name):
    """Thrust is held for 0.2 s: 3 cm off with time constants of 20 s and 3 s; 6 mm/min of drift
    rate; nonlinear gravity at 900 m of 42,164 km adds 2 cm.
    """
    result = flight(name)
    abort = next(i for i in INSTANCES if i.name == name).abort[1]
    t, s = benchmark(abort)
    rho = result["controller.rho_H"]
    for axis in (0, 1):
        expected = np.interp(result.time / 60, t, s[:, axis])
        assert np.max(np.abs(rho[:, axis] - expected)) < 0.15
    assert np.max(np.abs(rho[:, 2])) < 1e-6


@pytest.mark.parametrize("instance", INSTANCES, ids=lambda i: i.name)
def test_verdict_of_each_instance_is_the_published_one(instance):
    result = flight(instance.name)
    (paper,) = [p for p in PAPERS if p.belongs_to(result)]
    assert (paper is PAPERS[0]) == instance.safe
    assert [c.evaluate(result).verdict for c in paper.claims] == [Verdict.REPRODUCED] * 3
    assert not [c for c in paper.conditions if c.difference(result)]
    abort = result.parameters["controller.t_abort"] / 60
    assert instance.abort[0] <= abort <= instance.abort[1] or instance.abort[0] > NEVER / 100
    violated = result["monitor.violated"][-1]
    assert violated.tolist() == [0.0 if instance.safe else 1.0, 0, 0, 0, 0, 0]


def test_report_shows_the_verdict_beside_the_published_one():
    text, complete = report(flight("SRU01"))
    assert complete
    assert "unsafe, falsified" in " ".join(text.split())
    assert "3 claims: 3 reproduced" in text


def test_a_lighter_thrust_limit_would_be_noticed():
    """With half the braking gain the speed limit breaks, and the verdict with it."""
    result = run(
        "arch_rendezvous",
        every=50,
        stop=10_800,
        set=MONITOR_ALONE | {"controller.switch_distance": [300, 0]},
    )
    assert result["monitor.least_margin"][-1, 2] < 0
    claims = {c.name: c.evaluate(result).verdict for c in PAPERS[0].claims}
    assert claims["speed"] is Verdict.NOT_REPRODUCED


def test_least_margins_are_those_of_the_recorded_flight():
    """Rows every 10 s: never below what the monitor found, and near it."""
    result = flight("SRA01")
    rho, speed = result["controller.rho_H"], np.linalg.norm(result["controller.drho_H"], axis=1)
    phase = result["controller.phase"]
    keep_out, corridor, slack = result["monitor.least_margin"][-1, :3]
    attempt = phase == 2
    los = -rho[attempt, 0] * np.sin(np.pi / 6) - np.abs(rho[attempt, 1]) * np.cos(np.pi / 6)
    assert corridor <= los.min() < corridor + 0.3
    assert slack <= 0.055 - speed[attempt].max() < slack + 5e-4
    drift = np.max(np.abs(rho[phase != 2]), axis=1) - 0.2
    assert keep_out <= drift.min() < keep_out + 0.3


def test_first_violation_is_when_the_drift_enters_the_box():
    result = flight("SRU01")
    entered = result["monitor.t_first"][-1, 0]
    t, s = benchmark(260)
    inside = np.max(np.abs(s[:, :2]), axis=1) < 0.2
    assert abs(entered - 60 * t[np.flatnonzero(inside & (t >= 260))[0]]) < 3


def test_passive_safety_of_the_proof_is_predicted_from_every_sample():
    """SRA08: any abort up to 240 min drifts safely until 300 min. So from every sample up to 240
    min the drift of one hour keeps out of the box; by 260 min it does not (SRU01).
    """
    result = run("arch_rendezvous", every=300, set={"monitor.passive_time": 3600})
    margin = result["monitor.passive_margin"]
    assert np.min(margin[result.time <= 240 * 60]) > 0
    assert margin[np.searchsorted(result.time, 260 * 60)] < 0
    assert 240 * 60 < result["monitor.t_first"][-1, 3] < 260 * 60


@pytest.mark.long
@pytest.mark.parametrize("instance", INSTANCES, ids=lambda i: i.name)
def test_campaign_over_starts_and_abort_times(instance):
    """50 flights: corners, then a Sobol sequence. It finds what the proofs say, and proves nothing
    itself.
    """
    flights = campaign(instance, 50)
    worst = min(flights, key=lambda f: min(f.margins))
    assert len(flights) == 50
    assert worst.safe == instance.safe, worst


def test_study_finds_the_published_verdict_of_every_instance_from_a_start_of_the_box(tmp_path):
    definition = read_toml(paths.campaigns()["arch_rendezvous"]) | {"runs": 1}
    found = campaign_of(definition, tmp_path / "x.zarr", workers=1).data
    unsafe = dict(zip(found["params"].values, found["violated"].values, strict=True))
    assert unsafe == {i.name: float(not i.safe) for i in INSTANCES}
    assert np.all(np.isnan(found["at"].values) == (found["violated"].values == 0))
    for k, (low, high) in enumerate(START, start=1):
        assert low < found[f"servicer.rho_0_H[{k}]"].values[0] < high


def test_campaign_begins_with_the_corners_and_finds_the_unsafe_instance():
    unsafe = next(i for i in INSTANCES if i.name == "SRU01")
    flights = campaign(unsafe, 2)
    assert [f.start for f in flights] == [(-925, -425), (-925, -375)]
    assert [f.safe for f in flights] == [False, False]
