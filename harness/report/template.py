# SPDX-License-Identifier: BSD-2-Clause
"""Templates of the folder `page` filled with texts, numbers, scripts and libraries."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from harness.errors import HarnessError
from harness.report import libraries
from harness.report.arrays import Arrays


def render(template: str, arrays: Arrays, data: dict[str, Any], **texts: Any) -> str:
    """A page from a template: texts are filled in, numbers go to its scripts as JSON."""
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
    except ImportError as error:
        raise HarnessError("a report needs jinja2: pip install 'servicing-fmus[report]'") from error
    loader = PackageLoader("harness.report", "page")
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template)
    return page.render(
        **texts,
        data=_json(data),
        arrays=_json(arrays.content),
        scripts={name: libraries.script(name) for name in libraries.SCRIPTS},
        style=_file("style.css"),
        code={name: _file(f"{name}.js") for name in ("page", "plots", "replay")},
        version=version("servicing-fmus"),
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def _file(name: str) -> str:
    return (files("harness.report") / "page" / name).read_text(encoding="utf-8")


def _json(data: Any) -> str:
    """JSON that no markup ends: a script of the page holds it."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
