# SPDX-License-Identifier: BSD-2-Clause
"""Templates of the folder `page` filled with texts, numbers, scripts and libraries.

Plotly draws the plots, and K3D brings three.js for the replay; their scripts are in their Python
packages, of the extra `report`.
"""

from __future__ import annotations

import base64
import gzip
import importlib.util
import json
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import HarnessError, library
from harness.report.arrays import Canvas

SCRIPTS = {"plotly": "package_data/plotly.min.js", "k3d": "static/standalone.js"}
"""Script of a library in its package."""
CODE = (
    "symbols", "plots", "history", "shapes", "labels", "bodies", "marks", "sky", "cameras", "clock",
    "story", "record", "replay", "page",
)  # fmt: skip
"""Scripts of the page in the order in which they are loaded."""


@cache
def script(name: str) -> str:
    """Script of a library, compressed and as text; HarnessError naming the extra if it is not
    there.
    """
    found = importlib.util.find_spec(name)
    file = Path(found.origin).parent / SCRIPTS[name] if found and found.origin else None
    if file is None or not file.is_file():
        raise HarnessError(
            f"a report needs {name}: pip install 'servicing-fmus[report]' (or {name})"
        )
    return base64.b64encode(gzip.compress(file.read_bytes(), 4, mtime=0)).decode()


def render(template: str, canvas: Canvas, data: dict[str, Any], **texts: Any) -> str:
    """A page from a template: texts are filled in, numbers go to its scripts as JSON."""
    page: str = _template(template).render(
        **texts,
        points=canvas.points if canvas.thinned else 0,
        data=_json(data),
        arrays=_json(canvas.arrays.content),
        scripts={name: script(name) for name in SCRIPTS},
        style=text_of("style.css"),
        code=[text_of(f"{name}.js") for name in CODE],
        coasts=text_of("coasts.json"),
        version=version("servicing-fmus"),
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )
    return page


def _template(name: str) -> Any:
    jinja2 = library("jinja2", "report")
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("harness.report", "page"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def text_of(name: str) -> str:
    """A file of the folder `page`."""
    return (files("harness.report") / "page" / name).read_text(encoding="utf-8")


def _json(data: Any) -> str:
    """JSON that no markup ends: a script of the page holds it."""
    text = json.dumps(data, separators=(",", ":"), default=_plain)
    return text.replace("<", "\\u003c")


def _plain(value: Any) -> Any:
    """Numbers of numpy, which a mission's scene may hold, as Python's."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"the page holds numbers and texts, not {type(value).__name__}")
