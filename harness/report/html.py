# SPDX-License-Identifier: BSD-2-Clause
"""Choice of the page for a result, a comparison or a dataset, and its file."""

from __future__ import annotations

from pathlib import Path
from warnings import catch_warnings, simplefilter

from harness.errors import UsageError
from harness.files.output import written
from harness.report import campaign, comparison
from harness.report import live as live_page
from harness.report.run import of_run
from harness.results.files import read
from harness.results.result import Result
from harness.studies.compare import TABLE


def write(
    source: Result | str | Path,
    path: str | Path,
    live: bool = False,
    lesson: str | Path | None = None,
) -> Path:
    """Write the HTML report of a result, a results file, the folder of a comparison or the dataset
    of a campaign, and return its path.

    live: include the system of the run; the reader can change its parameters and run it again
    (extra `live`); lesson: TOML with exercises for a live page.

    Raises UsageError or ResultsError if the source cannot be read, HarnessError if a library of the
    extra `report` is missing, ResultsError if the page cannot be written.
    """
    with catch_warnings():
        simplefilter("ignore", RuntimeWarning)  # numpy warns of values that are not finite
        if live or lesson is not None:
            taught = None if lesson is None else live_page.read_lesson(Path(lesson))
            run = source if isinstance(source, Result) else read(Path(source))
            text = live_page.of_run(run, taught)
        else:
            text = of_run(source) if isinstance(source, Result) else _of_path(Path(source))
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
    raise UsageError(f"{source}: contains neither {TABLE} nor the dataset of a campaign")
