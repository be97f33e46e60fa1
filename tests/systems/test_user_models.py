# SPDX-License-Identifier: BSD-2-Clause
"""glTF models of a user in the replay: `[scene.models]` of a TOML. Every file is made here, byte by
byte.
"""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from harness import run
from harness.api import write_page
from harness.cli import main
from harness.errors import UsageError
from harness.mission import library
from harness.report import models
from tests.harness.report_page import Page

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype="<u2")
SHIFT = [0.5, -1.0, 2.0]


def glb(corners=CORNERS, faces=FACES):
    """A tetrahedron in a node that turns it by half a turn about z and shifts it; linear base
    colour 0.5, 0.25, 0.
    """
    data = corners.tobytes() + faces.tobytes()
    data += b"\0" * (-len(data) % 4)
    about = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [0, 0, 1, 0], "translation": SHIFT}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.0, 1.0]}}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": corners.nbytes},
            {"buffer": 0, "byteOffset": corners.nbytes, "byteLength": faces.nbytes},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(corners),
                "type": "VEC3",
                "min": corners.min(axis=0).tolist(),
                "max": corners.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5123, "count": faces.size, "type": "SCALAR"},
        ],
    }
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


@pytest.fixture(autouse=True)
def no_mission_stays(monkeypatch):
    """Forget the missions that other tests have named."""
    monkeypatch.setattr(library, "_named", {})


@pytest.fixture
def mine(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "sat.glb").write_bytes(glb())
    text = 'extends = "sync_approach"\n[scene.models]\ntarget = "sat.glb"\n'
    (folder / "system.toml").write_text(text)
    return folder


def page_of(result, path):
    return Page(write_page(result, path).read_text(encoding="utf-8"))


def test_a_model_is_where_the_body_was(mine, tmp_path):
    """Triangles in body axes and metres, turned and shifted as its node states, in its colour."""
    page = page_of(run(mine, stop=1.0), tmp_path / "x.html")
    scene = page.data["scene"]
    (target,) = (body for body in scene["bodies"] if body["name"] == "target")
    (part,) = target["parts"]
    required = CORNERS[FACES.ravel()] * [-1, -1, 1] + SHIFT
    assert np.allclose(page.array(part["corners"]), required, atol=1e-6)
    linear = np.array([0.5, 0.25, 0.0])
    srgb = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
    assert part["tint"] == pytest.approx(srgb, abs=0.005)
    assert target["radius"] == pytest.approx(np.linalg.norm(required, axis=1).max())
    (servicer,) = (body for body in scene["bodies"] if body["name"] == "servicer")
    assert not any(part["kind"] == "mesh" for part in servicer["parts"])


def test_the_page_needs_no_file_any_more(mine, tmp_path):
    """The model is in the page, and the report of a file finds it by the TOML of the run."""
    assert main(["run", str(mine), "--stop", "1", "-q", "-o", str(tmp_path / "x.nc")]) == 0
    assert main(["report", str(tmp_path / "x.nc"), "-o", str(tmp_path / "x.html")]) == 0
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert '"kind":"mesh"' in text
    assert "sat.glb" not in text.partition('id="data"')[2].partition("</script>")[0]


@pytest.mark.parametrize(
    ("models_", "problem"),
    [
        ('targe = "sat.glb"', "scene.models.targe: there is none of this name (close: target"),
        ('target = "none.glb"', "none.glb: there is no such file .glb or .gltf"),
        ('target = "sat.obj"', "sat.obj: there is no such file .glb or .gltf"),
        ("target = 3", "scene.models.target: must be a text, not 3"),
    ],
)
def test_an_invalid_model_is_reported_in_one_line_by_check(mine, capsys, models_, problem):
    text = f'extends = "sync_approach"\n[scene.models]\n{models_}\n'
    (mine / "system.toml").write_text(text)
    assert main(["check", str(mine)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert problem in lines[0]


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"nonsense", "is not a glTF file"),
        (glb()[:200], "is not a glTF file"),
        (glb(np.full((4, 3), np.nan, dtype="<f4")), "contains a vertex with a coordinate"),
    ],
)
def test_a_file_that_is_no_model_is_reported_in_one_line_of_the_report(
    mine, tmp_path, capsys, content, problem
):
    result = run(mine, stop=1.0)
    (mine / "sat.glb").write_bytes(content)
    assert (
        main(["report", str(result.save(tmp_path / "x.nc")), "-o", str(tmp_path / "x.html")]) == 2
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("harness: [scene.models] target: ")
    assert problem in line
    assert not (tmp_path / "x.html").exists()


def test_a_model_too_large_for_a_page_is_rejected_with_its_number(mine, tmp_path):
    count = models.MOST + 1
    many = np.tile(FACES[:1], (count, 1))
    (mine / "sat.glb").write_bytes(glb(faces=many))
    result = run(mine, stop=1.0)
    with pytest.raises(
        UsageError, match=f"target: has {count} triangles, more than the limit of {models.MOST}"
    ):
        write_page(result, tmp_path / "x.html")


def test_a_model_of_what_the_replay_does_not_show_is_rejected(mine, tmp_path):
    text = 'extends = "sync_approach"\n[scene.models]\nguidance = "sat.glb"\n'
    (mine / "system.toml").write_text(text)
    with pytest.raises(
        UsageError, match="guidance: the replay has no such body; its bodies are servicer"
    ):
        write_page(run(mine, stop=1.0), tmp_path / "x.html")
