# SPDX-License-Identifier: BSD-2-Clause
"""The blocks of the tutorial or of another page, and how they are run: in one folder, one after
the other, with a PATH on which there is a shell and one environment of Python, but no compiler.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"

LEFT = {"approach.nc", "approach.html", "mass.zarr", "three.nc", "compared", "mine"}
"""Files that they leave in the folder."""


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and text of the fenced blocks of a page of docs/."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(r"^```(\w+)\n(.*?)^```", text, re.M | re.S)


BLOCKS = blocks("tutorial.md")


def follow(
    folder: Path,
    tools: Path,
    programs: Path,
    followed: list[tuple[str, str]] = BLOCKS,
    file: str = "mass.toml",
) -> None:
    """Run every block; programs: folder of `harness` and `python`, tools: an empty folder,
    file: name of the TOML block.
    """
    (tools / "sh").symlink_to(shutil.which("sh"))
    environment = {n: v for n, v in os.environ.items() if n not in {"CC", "PYTHONPATH"}}
    environment |= {"PATH": f"{programs}{os.pathsep}{tools}", "MPLBACKEND": "agg"}
    assert shutil.which("cc", path=environment["PATH"]) is None
    output = ""
    for kind, text in followed:
        if kind == "toml":
            (folder / file).write_text(text)
        elif kind == "text":
            missing = [line for line in text.splitlines() if line not in output]
            assert not missing, f"{missing} not in\n{output}"
        else:
            command = ["sh", "-ec", text] if kind == "sh" else [programs / "python", "-c", text]
            output = run(command, folder, environment)


def run(command: list, folder: Path, environment: dict[str, str]) -> str:
    """Standard output and error of a command that succeeds."""
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr
