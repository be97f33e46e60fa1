# SPDX-License-Identifier: BSD-2-Clause
"""What matters in a campaign that has flown already, from its dataset alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import PENDING
from harness.studies.inquiry.sensitivity import hsic

LEAST = 50
"""Runs below which nothing can be said."""


def of_dataset(path: Path) -> Store:
    """The dataset with the dependence of every margin on every factor as its estimate."""
    store = Store.open(path)
    if "margin" not in store.group:
        raise UsageError(f"{path}: has no margins; [requirements] of the campaign makes them")
    flown = store.array("status") != PENDING
    if flown.sum() < LEAST:
        raise UsageError(
            f"{path}: the dataset holds {flown.sum()} completed runs; at least {LEAST} are needed"
        )
    seeds = store.definition()[0].get("seeds", ())
    names = [n for n in store.names("factor") if n not in seeds]
    columns: list[NDArray[np.float64]] = []
    groups: list[list[int]] = []
    width = 0
    for name in names:
        values = store.array(name)
        if values.dtype.kind not in "fiu":
            values = np.unique(values, return_inverse=True)[1]
        flat = values.reshape(len(values), -1)[flown].astype(np.float64)
        flat = (flat - flat.mean(axis=0)) / np.where(np.ptp(flat, axis=0) > 0, flat.std(axis=0), 1)
        groups.append([*range(width, width + flat.shape[1])])
        width += flat.shape[1]
        columns.append(flat)
    x, margins = np.concatenate(columns, axis=1), store.array("margin")[flown]
    found = {}
    for k, name in enumerate(store.array("requirement")):
        if np.isfinite(margins[:, k]).any():
            effects = hsic(groups, x, np.nan_to_num(margins[:, k], nan=np.inf, neginf=-np.inf))
            found[str(name)] = {
                "method": "given",
                "value": effects.value.tolist(),
                "p": effects.p.tolist() if effects.p is not None else [],
                "died": effects.died,
            }
    store.group.attrs["estimate"] = json.dumps({"of": found, "factors": names, "method": "given"})
    store.group.attrs["kind"] = "given"
    return store
