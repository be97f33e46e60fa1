# SPDX-License-Identifier: BSD-2-Clause
"""Check the first lines of commit messages: an imperative of at most 72 characters, with a capital
and without a full stop.

python .ci/subjects.py              # make lint: all commits since this file was added
python .ci/subjects.py FILE         # commit-msg hook: the message in a file
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LONGEST = 72
NO_VERB = re.compile("A|An|The|This|That|These|It|Its|All|Every|Each|New|No|Some|In|On|Of|For|With")
"""First words of subjects that name a thing and not a change, and are therefore reported."""
VERBS = ("Bias", "Bring", "Embed", "Focus", "String")
"""Imperatives that are accepted although they end like another form of a verb."""
GENERATED = ("Merge ", "Revert ", "fixup! ", "squash! ")
"""First words of subjects that git writes; such subjects are not checked."""


def problems(subject: str) -> Iterator[str]:
    """Yield what is wrong with a subject."""
    first = subject.partition(" ")[0]
    if subject.startswith(GENERATED):
        return
    if len(subject) > LONGEST:
        yield f"has {len(subject)} characters, at most {LONGEST}"
    if not first[:1].isupper():
        yield "must begin with a capital"
    if subject.endswith("."):
        yield "must end without a full stop"
    is_other_form = re.search(r"(?:[^e]ed|ing|[^s]s)$", first) and first not in VERBS
    if NO_VERB.fullmatch(first) or not first.isalpha() or is_other_form:
        yield f"must begin with an imperative verb, such as Add or Reject, not {first}"


def committed() -> list[str]:
    """Return the subjects of all commits after the commit that added this file; [] without git."""
    log = ["git", "-C", str(ROOT), "log", "--format=%H"]
    name = Path(__file__).relative_to(ROOT).as_posix()
    try:
        first = subprocess.check_output([*log, "--diff-filter=A", "--", name], text=True).split()
        since = [f"{first[-1]}..HEAD"] if first else ["-0"]
        return subprocess.check_output([*log[:-1], "--format=%s", *since], text=True).splitlines()
    except (OSError, subprocess.CalledProcessError):
        return []


def main(*files: str) -> int:
    """Check the messages in files, or without files all commits of committed(); print a line per
    problem; return 1 if there is any, otherwise 0.
    """
    texts = [Path(f).read_text(encoding="utf-8") for f in files]
    subjects = [text.strip().partition("\n")[0] for text in texts] if files else committed()
    found = [f"{subject!r}: {line}" for subject in subjects for line in problems(subject)]
    print("\n".join(found) or f"commit subjects: {len(subjects)} checked, nothing found")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
