# SPDX-License-Identifier: BSD-2-Clause
"""Build of an FMU from one C or Python file or a learned policy, in the source tree and from an
installed package.
"""

from __future__ import annotations

import copy
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from harness.authoring import policy
from harness.errors import FmuError, UsageError
from harness.files import adapter, paths
from harness.files.archive import pack, parsed, read_all, serialized
from harness.files.output import written
from harness.system.interface import read_interface

ENDINGS = (".c", ".py", ".npz", ".onnx")
DESCRIPTION = "modelDescription.xml"


def build(
    name: str | Path, output: str | Path | None = None, compiler: str = "cc", fmi: int = 2
) -> Path:
    """Build an FMU from a C or Python file, or from a policy, and return its path.

    name: the file (.c, .py, or a policy .npz or .onnx), or a folder NAME with one such file
    NAME.c, ...; output: path of the FMU (default: NAME.fmu beside the file); compiler: command for
    C with its arguments, quoted as in a shell; fmi: version of FMI, 2 or 3 (a Python file: 2 only).
    Raises UsageError if the file, the compiler or a package is missing, and FmuError with the
    message of the compiler.
    """
    source = _source(Path(name))
    target = Path(output) if output is not None else source.with_suffix(".fmu")
    if target.suffix != ".fmu":
        raise UsageError(f"--output {target}: expected a file NAME.fmu")
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / f"{source.stem}.fmu"
        if source.suffix in (".npz", ".onnx"):
            text = policy.read(source).source(source.stem)
            source = Path(folder) / f"{source.stem}.c"
            source.write_text(text, encoding="utf-8")
        if source.suffix == ".c":
            _build_c(source, made, compiler, fmi)
        elif fmi != 2:
            raise UsageError(f"{source}: Python FMUs support FMI 2.0 only; use --fmi 2")
        else:
            made = _build_python(source, Path(folder))
        with written(target) as file:
            shutil.copyfile(made, file)
    read_interface(target)  # raises FmuError if the source defines an invalid FMU
    return target


def _source(path: Path) -> Path:
    """Return the source file at a path, which may be a folder NAME with one file NAME.c, NAME.py,
    NAME.npz or NAME.onnx; raise UsageError if there is none or more than one.
    """
    inside = [path / f"{path.resolve().name}{ending}" for ending in ENDINGS]
    there = [file for file in (path, *inside) if file.suffix in ENDINGS and paths.is_file(file)]
    if len(there) == 1:
        return there[0]
    if there:
        raise UsageError(f"{path}: contains {there[0].name} and {there[1].name}; name one file")
    raise UsageError(
        f"{path}: expected an existing .c or .py file, policy .npz or .onnx, or folder with "
        f"{inside[0].name} or {inside[1].name}"
    )


def compiler_command(compiler: str) -> tuple[Path, list[str]]:
    """Return the folder of the C code that FMUs share, and a compiler command split into words;
    raise UsageError if the folder or the compiler is missing.
    """
    if (core := paths.core()) is None:
        raise UsageError("the C sources of the project are missing: reinstall servicing-fmus")
    try:
        command = shlex.split(compiler, posix=os.name == "posix")
    except ValueError as error:
        raise UsageError(f"--cc {compiler}: is not a command ({error})") from error
    if not command or shutil.which(command[0]) is None:
        raise UsageError(
            f"{' '.join(command) or '(nothing)'}: there is no such C compiler; install gcc or "
            "clang, or name yours with --cc of `harness build`"
        )
    return core, command


def _build_c(source: Path, output: Path, compiler: str, fmi: int) -> None:
    core, command = compiler_command(compiler)
    helper = [sys.executable, str(core / "build" / "build_fmu.py")]
    options = ["-o", str(output), f"--cc={shlex.join(command)}", f"--fmi={fmi}"]
    _run([*helper, str(source), *options, *adapter.options(command, fmi)], source)


def _build_python(source: Path, folder: Path) -> Path:
    if importlib.util.find_spec("pythonfmu") is None:
        raise UsageError(
            f"{source}: an FMU in Python needs PythonFMU: pip install pythonfmu (or install "
            "servicing-fmus with its extra `python`)"
        )
    helper = [sys.executable, "-m", "pythonfmu", "build"]
    _run([*helper, "-f", str(source.resolve()), "-d", str(folder)], source)
    found = list(folder.glob("*.fmu"))
    if len(found) != 1:
        raise FmuError(f"{source}: it has no class derived from Fmi2Slave of PythonFMU")
    _complete(found[0])
    return found[0]


def _complete(path: Path) -> None:
    """Add to an FMU of PythonFMU two parts of its model description that FMI 2.0 requires and
    PythonFMU omits: outputs in the list InitialUnknowns (2.2.8), braces around the guid (2.2.1).
    """
    content = read_all(path)
    root = parsed(content[DESCRIPTION])
    if not (guid := root.get("guid", "")).startswith("{"):
        root.set("guid", f"{{{guid}}}")
    structure, outputs = root.find("ModelStructure"), root.find("ModelStructure/Outputs")
    if outputs is not None and root.find("ModelStructure/InitialUnknowns") is None:
        initial = copy.deepcopy(outputs)
        initial.tag = "InitialUnknowns"
        structure.append(initial)
    content[DESCRIPTION] = serialized(root)
    pack(path, content, zipfile.ZIP_DEFLATED)


def _run(command: Sequence[str], source: Path) -> None:
    """Run the command that builds an FMU from `source`; if the command fails, raise FmuError with
    everything that it printed.
    """
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode:
        lines = [line for line in done.stdout.splitlines() if line.strip()]
        between = "\n" if len(lines) > 1 else " "
        raise FmuError(f"{source} does not build:{between}" + "\n".join(lines))
