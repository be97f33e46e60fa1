# SPDX-License-Identifier: BSD-2-Clause
"""3D replay of a mission: an approach with phases and events, and either probe and drogue on the
two bodies or an arm on the servicer.

After capture both bodies, which then form the stack, are still drawn, each at its own position.
"""

from __future__ import annotations

from functools import partial

from harness.mission import Scene
from harness.report.arrays import Arrays
from harness.report.timeline import event
from harness.results.result import Result, Rows

from ..arm_capture.scene import fit as arm
from ..shared.approach_scene import PAIR, Outfit, pair, pairs
from ..shared.docking_scene import DOCKING, drogue, floor, probe
from ..shared.scene import number, runs_of
from .events import DOCKING as CAPTURE
from .events import ISP, NEEDS, PHASE, captures, stays

LOAD = "mechanism.load_force"
ALARMS = ("back-off", "retreat", "safe", "aborted")


def _events(result: Result) -> list[dict[str, object]]:
    """Return the events of the replay: the phases, each with the reason why the previous phase
    ended, then the first contact and changes of the latch.
    """
    begun = [
        event(
            s.begin,
            s.phase + (f" ({s.reason})" if s.reason else ""),
            "abort" if s.phase in ALARMS else "phase",
        )
        for s in stays(result)
    ]
    return begun + [event(time, text, "capture") for time, text in captures(result)]


def fit(result: Result, rows: Rows, arrays: Arrays) -> Outfit | None:
    """Return the parts and values that the replay adds to an approach: probe and drogue or the arm,
    phase, latch, force on the probe, events; None for a result of another mission.

    rows: instants of the replay; arrays: arrays of the page, to which time series are added.
    """
    if not result.holds(*NEEDS, LOAD, parameters=(*DOCKING, ISP)):
        return None
    names = result.mode_names(PHASE)
    captured, phases = _events(result), tuple(runs_of(result[PHASE], result.time, names))
    course = {"values": arrays.sample(result, rows, PHASE), "words": names, "alarms": ALARMS}
    if (outfit := arm(result, rows, arrays)) is not None:
        both = sorted((*captured, *outfit.events), key=lambda each: each["time"])
        return outfit._replace(events=tuple(both), phases=phases, course=course)
    return Outfit(
        probe(result),
        drogue(result),
        floor(result),
        numbers=(
            number(result, arrays, rows, CAPTURE, result.mode_names(CAPTURE), "latch"),
            number(result, arrays, rows, LOAD, text="force on the probe"),
        ),
        events=tuple(captured),
        phases=phases,
        spot="drogue",
        course=course,
    )


SCENE = Scene(PAIR, (), partial(pair, fit=fit), partial(pairs, fit=fit))
