# SPDX-License-Identifier: BSD-2-Clause
"""3D replay of the capture by arm: links of the arm, gripper, fixture, path of the end effector."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from harness.mission import Scene
from harness.report.arrays import Arrays
from harness.report.timeline import event
from harness.results.result import Array, Result, Rows

from ..shared import bodies
from ..shared.approach_scene import PAIR, Outfit, pair, pairs
from ..shared.docking_scene import DOCKING, drogue, floor
from ..shared.scene import Part, joint, number, runs_of
from ..shared.scene import Scene as Data
from .kinematics import ARM, Arm, arm_of
from .metrics import MODE, TIP

ANGLES, CAPTURE, LOAD = "servicer.joint_angle", "mechanism.phase", "mechanism.load_force"
SHOWN = ((CAPTURE, "latch"), (TIP, "tip error"), (LOAD, "contact force"))
PATHS = (("end effector", "servicer.r_EN_N", "servicer.q_EN"),)


def links(arm: Arm, angle: str) -> Iterator[Data]:
    """Yield the links of the arm for the replay. Each link turns about its joint on the link
    before, and the last link carries the gripper. angle: name of the array of joint angles.
    """
    ends = [*arm.offset[1:], arm.tip]
    for k, (axis, at, end, thick) in enumerate(
        zip(arm.axis, arm.offset, ends, arm.radius, strict=True)
    ):
        hinge = bodies.rod(-thick * axis, thick * axis, 1.2 * thick)
        last = k == len(ends) - 1
        parts = gripper(arm) if last else [bodies.rod((0, 0, 0), end, thick, "arm")]
        on = {"on": k - 1} if k else {}
        yield joint(at, angle, k, [hinge, *parts], axis, **on)


def gripper(arm: Arm) -> list[Part]:
    """Return the parts of the last link: a rod and two fingers that end at the origin of E."""
    thick, (x, y, _) = float(arm.radius[-1]), arm.frame.T
    palm = arm.tip - 2 * thick * x
    fingers = [bodies.rod(palm + s * thick * y, arm.tip, 0.2 * thick, "accent") for s in (-1, 1)]
    return [bodies.rod((0, 0, 0), palm, thick, "arm"), *fingers]


def events(result: Result) -> list[Data]:
    """Return the events of the replay: every mode of the arm, and every change of the latch."""
    arm = runs_of(result[MODE], result.time, result.mode_names(MODE))
    latch = runs_of(result[CAPTURE], result.time, result.mode_names(CAPTURE))[1:]
    return [event(each["begin"], f"arm {each['text']}", "phase") for each in arm] + [
        event(each["begin"], f"latch: {each['text']}", "capture") for each in latch
    ]


def fit(result: Result, rows: Rows, arrays: Arrays) -> Outfit | None:
    """Return the parts and values that a capture by arm adds to the replay of an approach: arm,
    fixture, modes, errors; None for a result without an arm.
    """
    paths = (name for _, *names in PATHS for name in names)
    shown = (MODE, *(name for name, *_ in SHOWN))
    if not result.holds(ANGLES, *shown, *paths, parameters=(*ARM, *DOCKING)):
        return None
    arm = arm_of(result)
    if not len(arm.axis):
        return None
    words = tuple(f"arm {mode}" for mode in result.mode_names(MODE))
    lengths: Array = np.linalg.norm([*arm.offset, arm.tip], axis=1)
    return Outfit(
        [],
        drogue(result),
        floor(result),
        tuple(links(arm, arrays.sample(result, rows, ANGLES))),
        float(lengths.sum()),
        arm.offset[0],
        tuple(number(result, arrays, rows, n, result.mode_names(n), text) for n, text in SHOWN),
        tuple(events(result)),
        PATHS,
        tuple(runs_of(result[MODE], result.time, words)),
        course={"values": arrays.sample(result, rows, MODE), "words": words},
    )


SCENE = Scene(PAIR, (), partial(pair, fit=fit), partial(pairs, fit=fit))
