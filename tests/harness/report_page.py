# SPDX-License-Identifier: BSD-2-Clause
"""A report as a browser gets it: texts, numbers, and what it would load from elsewhere."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from html.parser import HTMLParser

import numpy as np


class Page(HTMLParser):
    """Everything that the tests look at in a page."""

    def __init__(self, text):
        super().__init__()
        self.size = len(text.encode())
        self.scripts, self.ids, self.links, self.words = {}, set(), [], []
        self.headings, self.alerts, self.policy = [], [], ""
        self._open = []
        self.feed(text)
        self.close()
        self.data = json.loads(self.scripts["data"])
        self.stored = json.loads(self.scripts["arrays"])

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self._open.append((tag, found))
        self.ids.add(found.get("id"))
        self.links += [v for k, v in attributes if k in ("src", "href", "srcset", "data")]
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy = found["content"]
        if tag in ("meta", "input", "link"):
            self._open.pop()

    def handle_endtag(self, tag):
        while self._open and self._open.pop()[0] != tag:
            pass

    def handle_data(self, text):
        tag, about = self._open[-1] if self._open else ("", {})
        if tag == "script":
            self.scripts[about.get("id", f"code{len(self.scripts)}")] = text
        elif tag != "style":
            self.words.append(text)
        if tag in ("h1", "h2", "h3"):
            self.headings.append(text.strip())
        if any(a.get("role") == "alert" for _, a in self._open):
            self.alerts.append(text.strip())

    def is_closed(self, *further):
        """Whether the policy allows no network and exactly the scripts of the page, but for further
        sources of scripts.
        """
        codes = [text for name, text in self.scripts.items() if name.startswith("code")]
        packed = [text for name, text in self.scripts.items() if name.startswith("script-")]
        codes = [text.encode() for text in codes]
        codes += [gzip.decompress(base64.b64decode(text)) for text in packed]
        hashes = [base64.b64encode(hashlib.sha256(code).digest()).decode() for code in codes]
        rules = dict(rule.strip().split(" ", 1) for rule in self.policy.split(";"))
        allowed = rules.pop("script-src").split()
        return (
            sorted(allowed) == sorted([*(f"'sha256-{each}'" for each in hashes), *further])
            and rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
            and {each for rule in rules.values() for each in rule.split()}
            <= {"'none'", "data:", "blob:", "'unsafe-inline'"}
        )

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    def array(self, name):
        retained = self.stored[name]
        return np.frombuffer(base64.b64decode(retained["data"]), "<f4").reshape(retained["shape"])

    def signal(self, name):
        """The plot of a variable; None if it does not change."""
        component, _, variable = name.partition(".")
        found = {c["name"]: c for c in self.data["signals"]}[component]
        return next((p for p in found["plots"] if p["variable"] == variable), None)

    def figures(self):
        return {f["name"]: f["plots"] for s in self.data["figures"] for f in s["figures"]}

    def body(self, name):
        return next(b for b in self.data["scene"]["bodies"] if b["name"] == name)
