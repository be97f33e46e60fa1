# SPDX-License-Identifier: BSD-2-Clause
"""Rendering of a page: templates in the folder `page` are filled with texts, data, scripts and
libraries.

Plotly draws the plots; three.js, which K3D contains, draws the replay. The scripts of both are in
their Python packages, which the extra `report` installs.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from harness import __version__
from harness.errors import installed, library
from harness.report.arrays import Canvas

SCRIPTS = {"plotly": "package_data/plotly.min.js", "k3d": "static/standalone.js"}
"""Path of the script of each library in its Python package."""
FONTS = re.compile(rb"@font-face\{(?:\$\{\w+\}|[^{}])*\}|data:font/woff2;base64,[\w+/=]*")
"""Regular expression of the fonts for formulas in the script of K3D. They are removed, because the
replay has no formulas and a browser would search for their files.
"""
CODE = (
    "symbols", "plots", "history", "shapes", "labels", "bodies", "zones", "sky", "cameras", "clock",
    "timeline", "record", "replay", "page",
)  # fmt: skip
"""Scripts of the page in the order in which they are loaded."""
LIVE = ("simulation", "program", "course", "live")
"""Further scripts of a live page, loaded after the others."""
POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; "
    "style-src 'unsafe-inline'; script-src"
)
"""Beginning of the Content-Security-Policy of every page, before the hashes of its scripts. It
forbids loading, sending and all other scripts. It does not prevent a script of the page from
opening a window. Inline styles are allowed, because Plotly and K3D write their own;
`default-src 'none'` prevents them from loading files.
"""


@cache
def _script(name: str) -> tuple[str, str]:
    """Return the script of a library, compressed and in base64, and the source expression by which
    the Content-Security-Policy allows it. Raises HarnessError with the extra to install if the
    library is missing.
    """
    package = Path(installed(name, "report").origin or "").parent
    text = FONTS.sub(b"", (package / SCRIPTS[name]).read_bytes())
    return base64.b64encode(gzip.compress(text, 4, mtime=0)).decode(), _source(text)


def _source(script: bytes) -> str:
    """Return the hash by which a Content-Security-Policy allows an inline script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"


def render(
    template: str, canvas: Canvas, data: dict[str, Any], live: bool = False, **texts: Any
) -> str:
    """Return a page as HTML text. The template is filled with `texts`, and contains `data` and the
    arrays of the canvas as JSON for its scripts.

    live: include the scripts that run the system, and allow WebAssembly in the policy.
    """
    code = [_text_of(f"{name}.js") for name in (*CODE, *(LIVE if live else ()))]
    libraries = {name: _script(name) for name in SCRIPTS}
    sources = [_source(text.encode()) for text in code] + [own for _, own in libraries.values()]
    page: str = _template(template).render(
        **texts,
        points=canvas.points if canvas.thinned else 0,
        data=_json(data),
        arrays=_json(canvas.arrays.content),
        scripts={name: packed for name, (packed, _) in libraries.items()},
        style=_text_of("style.css") + (_text_of("live.css") if live else ""),
        code=code,
        policy=" ".join([POLICY, *sources, *(["'wasm-unsafe-eval'"] if live else [])]),
        coasts=_text_of("coasts.json"),
        version=__version__,
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


def _text_of(name: str) -> str:
    """Return the text of a file in the folder `page`."""
    return (files("harness.report") / "page" / name).read_text(encoding="utf-8")


def _json(data: Any) -> str:
    """Return data as JSON for a script element of the page. `<` is escaped, so that no text can end
    the element, and null replaces numbers that are not finite, which JSON does not allow.
    """
    finite = json.loads(json.dumps(data, default=_plain), parse_constant=lambda _: None)
    return json.dumps(finite, separators=(",", ":")).replace("<", "\\u003c")


def _plain(value: Any) -> Any:
    """Return an array or number of numpy, which the scene of a mission may contain, as lists or
    numbers of Python; raise TypeError for other objects.
    """
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a page can contain numbers and texts only, not {type(value).__name__}")
