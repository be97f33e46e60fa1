# SPDX-License-Identifier: BSD-2-Clause
"""Tables of the capture by the arm: runs with several parameter sets, on truth and on estimates;
effect of the compensation on the base; reach of the arm.
"""

from __future__ import annotations

from typing import Any

from results import Column, of_runs

SETS = ("default", "fast", "friction", "limited")
CLEAN = "arm_capture --params clean"
CAPTURE = [
    Column("error of E in ALIGN, CLOSE [mm]", "tip error, aligning and closing", "{:.2g}"),
    Column("rms, second half of closing [mm]", "tip error, late", "{:.2g}"),
    Column("grip [s]", "grip", "{:.2f}"),
    Column("miss in truth at the grip [mm]", "miss at the grip", "{:.2g}"),
    Column("hard capture [s]", "hard capture", "{:.2f}"),
    Column("load of the mechanism [N]", "load of the gripper", "{:.2g}"),
]


def by_set(system: str) -> str:
    """Return a table of the runs of a system with each parameter set in SETS."""
    return of_runs("set", {f"`{s}`": f"{system} --params {s}" for s in SETS}, CAPTURE)


def deployment() -> str:
    """Return a table of the errors of the base from its reference while the arm deploys."""
    runs = {
        "torque compensated, as the system has it": CLEAN,
        "nothing compensated": f"{CLEAN} --set arm_controller.compensate_torque=0",
        "torque and force compensated": f"{CLEAN} --set arm_controller.compensate_force=1",
    }
    return of_runs("set `clean`, deployment", runs, [
        Column("attitude error of the base [deg]", "base attitude, deploying", "{:.3f}"),
        Column("position error of the base [mm]", "base position, deploying", "{:.1f}"),
    ])  # fmt: skip


def approach(name: str) -> Any:
    """Return a function from a result to the text `VALUE: VERDICT` of a claim about the
    synchronised approach; name: name of the claim.
    """

    def evaluate(result: Any) -> str:
        from harness.results.verdict import Kind
        from ssp.arm_capture.claims import APPROACH

        found = next(c for c in APPROACH.claims if c.name == name).evaluate(result)
        return f"{found.value}: {Kind.CLAIM.word(found.verdict)}"

    return evaluate


def reach() -> str:
    """Return a table of the claims that the arm can reach the target after the approach."""
    runs = {"nominal": "arm_capture", "`fast`": "arm_capture --params fast"}
    return of_runs("claim", runs, [
        Column('"within reach of the arm, and is then maintained"', approach("within reach")),
        Column('"can be grasped at any time"', approach("grasped at any time")),
    ], across=True)  # fmt: skip


VALUES = {
    "arm_deployment": deployment,
    "arm_sets": lambda: by_set("arm_capture"),
    "arm_estimates": lambda: by_set("arm_capture_navigated"),
    "arm_reach": reach,
}
