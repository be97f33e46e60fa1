# SPDX-License-Identifier: BSD-2-Clause
"""Three-dimensional models of the user in the replay: `[scene.models]` in the TOML of a system
names a glTF file per body.

The unit of glTF is the metre. The axes of the file are used as the body axes, and its origin as the
centre of mass. The page contains the triangles with one colour per material, but no textures and no
animation, so it needs no other file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import HarnessError, UsageError, library, reason_of
from harness.files import paths
from harness.mission.library import SYSTEM, systems
from harness.report.arrays import Arrays
from harness.results.result import Array, Result
from harness.ssp.extends import extended

Scene = dict[str, Any]

LARGEST = 64 * 1024**2
"""Largest size of a model file [bytes]."""
MOST = 60_000
"""Largest number of triangles of all models. They need 48 characters each, about half of the page.
"""


class Mesh(NamedTuple):
    """Triangles of one colour. corners: three rows for each triangle (3 * triangles, 3) [m], body
    axes; tint: red, green and blue from 0 to 1 in sRGB, None without a material.
    """

    corners: Array
    tint: tuple[float, float, float] | None


def named(result: Result) -> dict[str, Path]:
    """Return the model files by body that the TOML of the system names, {} if the TOML is not
    available; result: a run of the system.
    """
    source = _source(result)
    if source is None:
        return {}
    scene = extended(source).get("scene", {})
    return {body: Path(file) for body, file in scene.get("models", {}).items()}


def _source(result: Result) -> Path | None:
    """Return the path of the TOML of the system of a result, None if it is not available."""
    known = result.provenance
    if known is None or not known.source:
        return None
    given = Path(known.source)
    path = given / SYSTEM if paths.is_folder(given) else given
    if path.suffix == ".toml" and paths.is_file(path):
        return path
    return systems().get(result.system)


def with_models(scene: Scene, files: Mapping[str, Path], arrays: Arrays) -> Scene:
    """Return a scene in which models replace the parts of bodies; parts on joints remain.

    files: glTF file by body. Raises UsageError if the scene has no such body, a file is not glTF,
    or there are too many triangles.
    """
    known = [body["name"] for body in scene["bodies"]]
    for name in files:
        if name not in known:
            raise _error(name, f"the replay has no such body; its bodies are {', '.join(known)}")
    meshes = {name: meshes_of(name, path) for name, path in files.items()}
    count = sum(len(mesh.corners) // 3 for found in meshes.values() for mesh in found)
    if count > MOST:
        raise _error(
            ", ".join(files),
            f"has {count} triangles, more than the limit of {MOST}; simplify the model",
        )
    bodies = [_with_model(body, meshes.get(body["name"]), arrays) for body in scene["bodies"]]
    return scene | {"bodies": bodies}


def _with_model(body: Scene, meshes: tuple[Mesh, ...] | None, arrays: Arrays) -> Scene:
    if meshes is None:
        return body
    parts = [
        {"kind": "mesh", "corners": arrays.store(mesh.corners), "tint": mesh.tint}
        for mesh in meshes
    ]
    radius = max(float(np.linalg.norm(mesh.corners, axis=1).max()) for mesh in meshes)
    return body | {"parts": parts, "radius": radius, "reach": max(radius, body["reach"])}


def meshes_of(body: str, path: Path) -> tuple[Mesh, ...]:
    """Return the triangles of a glTF file, with the transformations of all nodes applied; raise
    UsageError if the file cannot be used. body: name for the message.
    """
    try:
        stamp = paths.stamp(path)
        if stamp.size > LARGEST:
            raise _error(body, f"{path}: has {stamp.size} bytes, the limit is {LARGEST}")
        return _checked(body, path, _read(path, stamp))
    except OSError as error:
        raise _error(body, f"{path}: cannot be read ({error.strerror or error})") from error
    except HarnessError:
        raise
    except Exception as error:  # the library that reads glTF may raise anything
        raise _error(body, f"{path}: is not a glTF file ({reason_of(error)[:200]})") from error


def _checked(body: str, path: Path, meshes: tuple[Mesh, ...]) -> tuple[Mesh, ...]:
    if not meshes:
        raise _error(body, f"{path}: contains no triangles")
    if not all(np.isfinite(mesh.corners).all() for mesh in meshes):
        raise _error(body, f"{path}: contains a vertex with a coordinate that is not finite")
    return meshes


@lru_cache(maxsize=8)
def _read(path: Path, _stamp: Any) -> tuple[Mesh, ...]:
    scene = library("trimesh", "report").load_scene(str(path), process=False)
    return tuple(_meshes(scene))


def _meshes(scene: Any) -> Iterator[Mesh]:
    for part in scene.dump():
        if len(getattr(part, "faces", ())):  # not lines or points
            yield Mesh(np.asarray(part.triangles, dtype=float).reshape(-1, 3), _colour(part.visual))


def _colour(visual: Any) -> tuple[float, float, float] | None:
    """Return the base colour of a material in sRGB (linear in glTF), None without a material."""
    factor = getattr(getattr(visual, "material", None), "baseColorFactor", None)
    if factor is None:
        return None
    whole = 255 if np.asarray(factor).dtype.kind == "u" else 1
    linear = np.asarray(factor, dtype=float)[:3] / whole
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    red, green, blue = (round(float(x), 4) for x in shown)
    return red, green, blue


def _error(body: str, problem: str) -> UsageError:
    return UsageError(f"[scene.models] {body}: {problem}")
