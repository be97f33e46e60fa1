"""Claims of the papers behind the systems: one file per paper, each a table that a result is compared with."""

from __future__ import annotations

from harness.claims.claim import Claim, Judgement, Paper, Verdict
from harness.claims.zhu_yang_2009 import PAPER as ZHU_YANG_2009

PAPERS: tuple[Paper, ...] = (ZHU_YANG_2009,)

__all__ = ["PAPERS", "Claim", "Judgement", "Paper", "Verdict"]
