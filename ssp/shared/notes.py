# SPDX-License-Identifier: BSD-2-Clause
"""What a reader of a result must know and no number in it says."""

from __future__ import annotations

from collections.abc import Iterator

from harness.results.result import Result

from .relative_motion import release_time

TORQUE_COMMANDS = ("propulsion.M_S", "controller.wheel_accel_cmd")
"""What is meant to turn the servicer."""


def notes(result: Result) -> Iterator[str]:
    """One line per fact."""
    yield from _torque_without_effect(result)


def _torque_without_effect(result: Result) -> Iterator[str]:
    """Torque on a servicer whose attitude is still frozen."""
    release = min(release_time(result), result.time[-1])
    frozen = result.time < release
    for name in TORQUE_COMMANDS:
        if name in result and result[name][frozen].any():
            yield (
                f"the attitude of the servicer is frozen before {release:g} s, so {name} acts on "
                f"nothing until then; to turn it from the start: --set servicer.t_att=0"
            )
            return
