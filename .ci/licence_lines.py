"""Add the licence line (SPDX) to C and Python files without one; --check only lists these files.

Usage: licence_lines.py [--check] FOLDER...

In C the line follows the opening comment, which is the documentation of an FMU; in Python it is the
first line.
"""

import argparse
import sys
from pathlib import Path

LINE = "SPDX-License-Identifier: BSD-2-Clause"


def with_line(text: str, ending: str) -> str:
    """Return the text of a C or Python file with the licence line, which is inserted at its
    place if it is missing; ending: ending of the file's name, such as ".py".
    """
    if LINE in text:
        return text
    if ending == ".py":
        return f"# {LINE}\n{text}"
    end = text.index("*/") + len("*/\n") if text.startswith("/*") else 0
    return f"{text[:end]}/* {LINE} */\n{text[end:]}"


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--check", action="store_true")
    parser.add_argument("folders", type=Path, nargs="+")
    a = parser.parse_args()
    files = [p for f in a.folders for p in f.rglob("*") if p.suffix in {".c", ".h", ".py"}]
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(files)}
    lacking = [path for path, text in texts.items() if LINE not in text]
    for path in lacking:
        if a.check:
            print(f"{path}: no licence line: run make format")
        else:
            path.write_text(with_line(texts[path], path.suffix), encoding="utf-8")
    sys.exit(a.check and bool(lacking))


if __name__ == "__main__":
    main()
