# SPDX-License-Identifier: BSD-2-Clause
"""The page: which one belongs to what is given, and its file."""

from __future__ import annotations

from pathlib import Path

from harness.errors import UsageError
from harness.files.output import written
from harness.report import campaign, comparison
from harness.report.fly import of_run as live
from harness.report.run import of_run
from harness.results.files import read
from harness.results.result import Result
from harness.studies.compare import TABLE


def write(source: Result | str | Path, path: str | Path, fly: bool = False) -> Path:
    """Write the report of a result, a results file, the folder of a comparison or the dataset of a
    campaign to a page of HTML.

    fly: with the system of the run inside, which the reader can change and fly again (extra `fly`).

    Raises UsageError or ResultsError if it cannot be read, HarnessError if a library of the extra
    `report` is missing, ResultsError if the page cannot be written.
    """
    if not fly:
        text = of_run(source) if isinstance(source, Result) else _of_path(Path(source))
    else:
        text = live(source if isinstance(source, Result) else read(Path(source)))
    page = Path(path)
    with written(page) as target:
        target.write_text(text, encoding="utf-8")
    return page


def _of_path(source: Path) -> str:
    if not source.is_dir():
        return of_run(read(source))
    if (source / TABLE).is_file():
        return comparison.of_folder(source)
    if (source / "zarr.json").is_file():
        return campaign.of_dataset(source)
    raise UsageError(f"{source}: holds neither a {TABLE} nor the dataset of a campaign")
