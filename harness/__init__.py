"""Run systems of FMUs with fixed macro steps.

>>> from harness import run
>>> result = run("sync_approach", set=["servicer.mass_0=120"])
>>> result["servicer.r_SN_N"].shape
(18001, 3)
"""

from harness.errors import HarnessError
from harness.results import Result
from harness.run import run

__all__ = ["HarnessError", "Result", "run"]
