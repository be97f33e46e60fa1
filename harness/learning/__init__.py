# SPDX-License-Identifier: BSD-2-Clause
"""Systems as environments of Gymnasium for reinforcement learning, and trained networks as FMUs.

The input is a system, with the components that an agent replaces. The outputs are observations,
rewards and the ends of episodes. Rewards and ends are defined by the same expressions and
requirements as in other runs, so an agent is trained on the criteria by which runs are evaluated.
The package imports harness.studies, because an episode can start like a run of a campaign.

The import of this package registers a Gymnasium id for every system of the available missions, such
as `servicing/SyncApproach-v0` for `sync_approach`, with actions between -1 and 1.
`gymnasium.make("harness.learning:servicing/SyncApproach-v0")` imports the package by itself.
"""

from __future__ import annotations

import gymnasium

from harness.mission.library import systems

for _name in systems():
    gymnasium.register(
        f"servicing/{''.join(part.capitalize() for part in _name.split('_'))}-v0",
        entry_point="harness.api:environment",
        vector_entry_point="harness.learning.vector:environments",
        kwargs={"system": _name, "scale": {}},
    )
