# SPDX-License-Identifier: BSD-2-Clause
"""A campaign whose controller is on a board."""

from __future__ import annotations

import pytest

from harness import campaign, run
from harness.errors import StructureError


def test_a_campaign_fixes_where_a_component_runs(board, tmp_path):
    """The bits of the FMU itself, in every run."""
    factors = {"servicer.mass_0": {"list": [95.0, 105.0]}}
    metrics = {"torque": "last(controller.M_cmd_S[1])"}
    given = {"system": "sync_approach", "factors": factors, "metrics": metrics}
    with board() as there:
        fixed = {"stop": 2.0, "on": {"controller": there.place}}
        simulated = campaign({**given, "fixed": fixed}, tmp_path / "there.zarr", workers=0)
    for k, mass in enumerate(factors["servicer.mass_0"]["list"]):
        here = run("sync_approach", stop=2.0, set={"servicer.mass_0": mass})
        assert simulated.store.array("torque")[k] == here["controller.M_cmd_S"][-1, 0]
        assert simulated.store.array("last")[k].tobytes() == here.values[-1].tobytes()
    with pytest.raises(StructureError, match=r"fixed: --on driver: sync_approach has no such comp"):
        campaign({**given, "fixed": {"on": ["driver=cortex-m7"]}}, tmp_path / "o.zarr", workers=0)
