# SPDX-License-Identifier: BSD-2-Clause
"""Write one FMU as an archive for FMI 2.0, one for FMI 3.0, or both. An archive contains model
description, binaries, sources, documentation, licence, and a picture of the model as a block with
its ports. The same inputs give the same bytes.

Usage: package_fmu.py [--fmi2 OUTPUT XML] [--fmi3 OUTPUT XML] --license FILE --binary
PLATFORM=FILE... --source FILE... --include DIR... [--trace FILE] [--provenance FILE]. The first
source is the C file of the model; its opening comment (equations, source) becomes the
documentation. The headers that the sources include, directly or not, are searched in the given
folders and written into sources/ too. An archive contains the sources for its version of FMI only.
"""

import argparse
import html
import io
import re
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

from package_fmi3 import PLATFORMS, build_description, icons, terminals
from PIL import Image, ImageDraw, ImageFont
from reference_trace import reference_files
from start_values import START_VALUES
from typeset import NotationError, page

FIXED_DATE = (1980, 1, 1, 0, 0, 0)
STYLE = (
    "body{font-family:sans-serif;max-width:70em;margin:2em auto}pre{background:#f4f4f4;padding:1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.2em .6em;text-align:left}"
    ".equations{margin:.6em 1.5em;overflow-x:auto}.equations div{margin:.35em 0;white-space:nowrap}"
    ".number{float:right}"
)
PROVENANCE = "extra/io.github.servicing-fmus/provenance.json"
SECTIONS = {"input": "Inputs", "output": "Outputs", "parameter": "Parameters"}


def read_rows(description: ElementTree.Element) -> list[dict[str, str]]:
    """Return one row per variable of a model description, with its XML attributes and its shape and
    start values as text. The elements of a vector or matrix are one row; the independent variable
    of FMI 3.0 is omitted.
    """
    rows: dict[str, dict[str, str]] = {}
    for variable in description.iter("Float64"):
        if variable.attrib["causality"] != "independent":
            shape = [e.attrib["start"] for e in variable.iter("Dimension")]
            starts = variable.get("start", "")
            row = {**variable.attrib, "shape": "x".join(shape) or "1", "starts": starts}
            rows[variable.attrib["name"]] = row
    for variable in description.iter("ScalarVariable"):
        name, _, index = variable.attrib["name"].partition("[")
        real = variable.find("Real")
        assert real is not None
        row = rows.setdefault(name, {"starts": "", **variable.attrib, **real.attrib, "name": name})
        row["shape"] = "x".join(index.rstrip("]").split(",")) if index else "1"
        row["starts"] += " " + real.get("start", "")
    return list(rows.values())


def limits(row: dict[str, str]) -> str:
    """Return the declared range of a variable as text, "" if it has none."""
    low, high = row.get("min"), row.get("max")
    return "" if low is None else f"{low} .. {high}" if high else f">= {low}"


def headers_of(sources: list[Path], folders: list[Path]) -> list[Path]:
    """Return the headers in `folders` that the sources include, directly or through headers."""
    found: dict[str, Path] = {}
    waiting = list(sources)
    while waiting:
        for name in re.findall(r'^#include "(.+?)"', text_of(waiting.pop()), re.MULTILINE):
            header = next((folder / name for folder in folders if (folder / name).exists()), None)
            if header and name not in found:
                found[name] = header
                waiting.append(header)
    return list(found.values())


def table(rows: list[dict[str, str]]) -> str:
    """Return an HTML table of variables; rows: as read_rows() returns them."""
    titles = ("name", "size", "unit", "limits", "start", "description")
    head = "<tr>" + "".join(f"<th>{title}</th>" for title in titles) + "</tr>"
    cells = (
        (r["name"], r["shape"], r["unit"], limits(r), r["starts"].strip(), r["description"])
        for r in rows
    )
    body = (
        "<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in cell) + "</tr>" for cell in cells
    )
    return f"<table>{head}{''.join(body)}</table>"


def text_of(source: Path) -> str:
    """Return the text of a C file; exit if it is not UTF-8."""
    try:
        return source.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        sys.exit(f"{source.name}: must be text in UTF-8 ({error.reason} at byte {error.start})")


def opening_comment(source: str) -> str:
    """Return the text of the opening comment of a C file without its asterisks; raise ValueError if
    there is none.
    """
    match = re.match(r"/\*(.*?)\*/", source, re.DOTALL)
    if match is None:
        raise ValueError("must begin with a comment /* ... */: equations and their source")
    return "\n".join(line.removeprefix(" *").rstrip() for line in match[1].splitlines())


def equations(comment: str) -> str:
    """Return the HTML of the opening comment of a C file. Lines indented by three blanks are
    equations. If one is not in the notation of typeset.py, the comment is shown as plain text.
    """
    try:
        return page(comment, indent=3)
    except NotationError:
        return f"<pre>{html.escape(comment)}</pre>"


def timing(rows: list[dict[str, str]]) -> str:
    """Return a sentence that states when a model computes: sampled, continuous, or once per step,
    as the names of its parameters in `rows` show.
    """
    named = {row["name"] for row in rows if row["causality"] == "parameter"}
    if "sample_period" in named:
        return (
            "Sampled: the model computes at the multiples of sample_period (0: at every"
            " communication point) and holds its outputs in between."
        )
    if "max_step" in named:
        return (
            "Continuous: the model integrates with fixed steps of at most max_step on the grid"
            " k max_step, k = 0, 1, ...; inputs are held over a communication step."
        )
    return "The model computes once in every communication step, with inputs held over the step."


def start_values(name: str) -> str:
    """Return the HTML of a paragraph that names the system from which the start values of an FMU
    are taken.
    """
    place, other = START_VALUES[name]
    system, _, component = place.partition(".")
    but = f" Parameters with another value in that component: {', '.join(other)}." if other else ""
    return (
        f"<p>Start values: of system {system}, component {component}.{but} Components of other"
        " missions need values of their own.</p>"
    )


def chapters(description: ElementTree.Element, source: str) -> list[tuple[str, str]]:
    """Return titles and HTML of the chapters about a model, for the page in its FMU and its page on
    the site; description: its modelDescription.xml; source: text of its C file.
    """
    rows = read_rows(description)
    alarms = set(re.findall(r"\bALARM\((\w+)", source))
    state = re.search(r"^typedef struct \{(?:(?!^typedef).)*?\} State;", source, re.M | re.S)
    parts = [
        ("Equations and source", equations(opening_comment(source))),
        ("Timing", f"<p>{timing(rows)} Outputs are latched at the end of a step and after "
         "initialization.</p>"),
    ]  # fmt: skip
    name = description.attrib["modelName"]
    if name in START_VALUES:
        parts.append(("Start values", start_values(name)))
    for causality, title in SECTIONS.items():
        chosen = [r for r in rows if r["causality"] == causality]
        parts.append((title, table(chosen) if chosen else "<p>none</p>"))
    raised = [r for r in rows if r["name"] in alarms]
    parts.append(("Alarms", table(raised) if raised else "<p>none</p>"))
    if state:
        parts.append(("State", f"<pre>{html.escape(state[0])}</pre>"))
    return parts


def documentation(description: ElementTree.Element, source: str) -> str:
    """Return the text of documentation/index.html, one page with all chapters."""
    name = html.escape(description.attrib["modelName"])
    text = html.escape(description.attrib["description"])
    parts = [
        "<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'>",
        f"<title>{name}</title><style>{STYLE}</style></head><body>",
        f"<h1>{name}</h1><p>{text}</p><p><img src='model.png' alt='ports of {name}'></p>",
        "<p>SI units, radians. Frames: N inertial, H Hill frame of the target orbit,",
        "T target body, S servicer body, D desired servicer body.</p>",
        *(f"<h2>{title}</h2>{body}" for title, body in chapters(description, source)),
    ]
    return "\n".join([*parts, "</body></html>", ""])


def picture(description: ElementTree.Element) -> bytes:
    """Return a PNG image of the model as a block with its inputs at the left and its outputs at the
    right edge.
    """
    rows = read_rows(description)
    left = [r["name"] for r in rows if r["causality"] == "input"]
    right = [r["name"] for r in rows if r["causality"] == "output"]
    font, title = ImageFont.load_default(14), ImageFont.load_default(18)
    height = 70 + 22 * max(len(left), len(right), 2)
    image = Image.new("RGB", (480, height), "white")
    draw = ImageDraw.Draw(image)
    draw.rectangle((12, 8, 467, height - 8), outline="#204a87", width=3)
    draw.text((240, 30), description.attrib["modelName"], fill="#204a87", font=title, anchor="mm")
    for k, (names, x, anchor) in enumerate(((left, 30, "lm"), (right, 450, "rm"))):
        for i, name in enumerate(names):
            y = 66 + 22 * i
            edge = 12 if k == 0 else 467
            draw.polygon([(edge - 6, y - 5), (edge + 6, y), (edge - 6, y + 5)], fill="#204a87")
            draw.text((x, y), name, fill="black", font=font, anchor=anchor)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def write_zip(output: Path, files: dict[str, bytes]) -> None:
    """Write files, given as bytes by name, into a zip archive, sorted and with a fixed date."""
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, FIXED_DATE)
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name])


class Files:
    """Files that the archives of a model contain, read from the options of the command line."""

    def __init__(self, a: argparse.Namespace) -> None:
        self.sources = list(dict.fromkeys(a.source))
        self.include, self.license, self.binaries = a.include, a.license.read_bytes(), a.binary
        self.model = text_of(self.sources[0])
        self.trace = a.trace.read_bytes() if a.trace else b""
        self.provenance = {PROVENANCE: a.provenance.read_bytes()} if a.provenance else {}

    def archive(self, xml: Path, fmi: str) -> dict[str, bytes]:
        """Return the files of the archive, as bytes by name, for FMI `fmi` ("2" or "3"); raise
        ValueError if the C file has no opening comment.
        """
        description = ElementTree.parse(xml).getroot()
        identifier = description.attrib["modelName"]  # equals modelIdentifier
        others = tuple(f"fmi{number}" for number in "23" if number != fmi)
        sources = [path for path in self.sources if not path.stem.startswith(others)]
        png = picture(description)
        headers = headers_of(sources, self.include)
        files = {
            "modelDescription.xml": xml.read_bytes(),
            "documentation/index.html": documentation(description, self.model).encode(),
            "documentation/model.png": png,
            **{f"sources/{path.name}": path.read_bytes() for path in [*sources, *headers]},
            **reference_files(self.trace),
            **self.provenance,
        }
        for binary in self.binaries:
            platform, _, file = binary.partition("=")
            place = platform if fmi == "2" else PLATFORMS.get(platform, platform)
            files[f"binaries/{place}/{identifier}{Path(file).suffix}"] = Path(file).read_bytes()
        if fmi == "2":
            return {**files, "model.png": png, "licenses/license.txt": self.license}
        files["documentation/licenses/license.txt"] = self.license
        listed = build_description(identifier, [path.name for path in sources])
        files["sources/buildDescription.xml"] = listed.encode()
        if plugs := terminals(read_rows(description)):
            files["terminalsAndIcons/terminalsAndIcons.xml"] = plugs.encode()
            files.update(icons(identifier))
        return files


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    for fmi in "23":
        parser.add_argument(f"--fmi{fmi}", type=Path, nargs=2, metavar=("OUTPUT", "XML"))
    parser.add_argument("--license", type=Path, required=True)
    parser.add_argument("--binary", action="append", required=True, metavar="PLATFORM=FILE")
    parser.add_argument("--source", type=Path, nargs="+", required=True)
    parser.add_argument("--include", type=Path, nargs="+", required=True)
    parser.add_argument("--provenance", type=Path, help="JSON file: provenance of a system")
    parser.add_argument("--trace", type=Path, help="reference outputs, reference.csv of FMI-LS-REF")
    a = parser.parse_args()
    files = Files(a)
    try:
        for fmi, output in (("2", a.fmi2), ("3", a.fmi3)):
            if output:
                write_zip(output[0], files.archive(output[1], fmi))
    except ValueError as error:
        sys.exit(f"{a.source[0].name}: {error}")


if __name__ == "__main__":
    main()
