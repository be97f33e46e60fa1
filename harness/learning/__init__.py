# SPDX-License-Identifier: BSD-2-Clause
"""Systems as environments of Gymnasium, and policies as FMUs.

A system enters with the components that an agent replaces. Observations, rewards and the end of an
episode leave, in the language of requirements, so that what is learned is what is evaluated. The
package is above the studies because an episode starts as a run of a campaign does.

Its import registers an id for every system of the available missions, `servicing/SyncApproach-v0`
for `sync_approach`, with actions in -1 to 1;
`gymnasium.make("harness.learning:servicing/SyncApproach-v0")` imports it.
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
