# SPDX-License-Identifier: BSD-2-Clause
"""Claims of the papers behind the systems: one file per paper, each a table that a result is
compared with.
"""

from __future__ import annotations

from harness.claims import arch_comp_spre, guo_2014, navigation, yin_2017
from harness.claims.claim import Claim, Judgement, Paper, Verdict
from harness.claims.kozlova_fomichev_2023 import PAPER as KOZLOVA_FOMICHEV_2023
from harness.claims.zhang_2016 import PAPER as ZHANG_2016
from harness.claims.zhu_yang_2009 import PAPER as ZHU_YANG_2009

PAPERS: tuple[Paper, ...] = (
    ZHU_YANG_2009,
    KOZLOVA_FOMICHEV_2023,
    *yin_2017.PAPERS,
    ZHANG_2016,
    *guo_2014.PAPERS,
    navigation.PAPER,
    *arch_comp_spre.PAPERS,
)

__all__ = [
    "KOZLOVA_FOMICHEV_2023",
    "PAPERS",
    "ZHANG_2016",
    "ZHU_YANG_2009",
    "Claim",
    "Judgement",
    "Paper",
    "Verdict",
]
