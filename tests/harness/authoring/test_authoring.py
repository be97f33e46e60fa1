# SPDX-License-Identifier: BSD-2-Clause
"""`harness new` and `harness build`: what is created runs as it is, and every error states the
reason.
"""

from __future__ import annotations

import keyword
import re
import shutil
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from harness import HarnessError, run, show
from harness import build as build_path
from harness.authoring import build as building
from harness.authoring.build import build
from harness.authoring.new import new_component
from harness.cli.app import main
from harness.files import adapter, paths
from harness.master.fused import OF_PROCESSOR
from harness.results.requirements import findings
from harness.results.verdict import Verdict
from harness.studies.check import check
from harness.system.interface import read_interface
from tests.each import each


def simulate_case(place, name, stop, **changes):
    """Run a system with the FMU in folder `name` in its place."""
    system, component = place.split(".")
    return run(system, swap={component: name}, stop=stop, **changes)


def ports(place):
    """Driven inputs and outputs that are read, with shapes, of a component of ours."""
    return {(s.name, s.causality, s.shape) for s in show(place).rows if s.wires}


@pytest.fixture(scope="module")
def twins(tmp_path_factory):
    """Folders of the example in C and in Python, made and built by the command lines."""
    folder = tmp_path_factory.mktemp("twins")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, language in (("my_pd", "c"), ("my_py", "python")):
            assert main(["new", "controller", name, "--language", language]) == 0
            assert main(["build", name]) == 0
    return folder / "my_pd", folder / "my_py"


def test_the_controller_in_c_runs_as_it_is_and_obeys_its_law(twins):
    """F = -K (rho - rho_ref) - D (drho - drho_ref), turned into S axes by the quaternion of S."""
    result = simulate_case("sync_approach.controller", twins[0], 20.0)
    K, D = result.parameter("controller.K"), result.parameter("controller.D")
    # a row holds what was commanded from the states of the row before
    state = {
        n: result[n][:-1]
        for n in ("servicer.r_SN_N", "servicer.v_SN_N", "target.r_TN_N", "target.v_TN_N")
    }
    rho = state["servicer.r_SN_N"] - state["target.r_TN_N"]
    drho = state["servicer.v_SN_N"] - state["target.v_TN_N"]
    e, de = rho - result["guidance.rho_ref_N"][1:], drho - result["guidance.drho_ref_N"][1:]
    F_N = -K * e - D * de
    w, v = result["servicer.q_SN"][:-1, :1], result["servicer.q_SN"][:-1, 1:]
    F_S = F_N - 2 * w * np.cross(v, F_N) + 2 * np.cross(v, np.cross(v, F_N))
    assert np.abs(F_S).max() > 0.1
    assert result["controller.F_cmd_S"][1:] == pytest.approx(F_S, abs=1e-6)


def test_an_fmu_has_the_same_bytes_without_a_cache(twins, tmp_path, monkeypatch):
    """There, the adapter is compiled for it; the twin links one that was compiled before."""
    assert adapter.options(["cc"], 2)
    monkeypatch.setenv("HARNESS_CACHE", "off")
    assert adapter.options(["cc"], 2) == []
    build(twins[0] / "my_pd.c", tmp_path / "my_pd.fmu")
    assert (tmp_path / "my_pd.fmu").read_bytes() == (twins[0] / "my_pd.fmu").read_bytes()


def test_a_compiler_with_arguments_compiles_the_adapter_itself(monkeypatch):
    assert adapter.options(["cc", "-include", "mine.h"], 2) == []
    for_processor = adapter.options(["cc", *OF_PROCESSOR], 2)
    assert for_processor
    assert (for_processor == adapter.options(["cc"], 2)) == (not OF_PROCESSOR)
    monkeypatch.setattr(adapter.shutil, "which", lambda name: "/bin/false")
    assert adapter.options(["false"], 2) == []


def test_its_torque_turns_the_servicer_to_the_reference_attitude(twins):
    """M = -K_att e - D_att (omega_S - C_SD omega_D), by rotations of scipy."""
    result = simulate_case("sync_approach.controller", twins[0], 20.0)
    K, D = result.parameter("controller.K_att"), result.parameter("controller.D_att")
    S, ref = (Rotation.from_quat(np.roll(q, -1, axis=1)) for q in
              (result["servicer.q_SN"][:-1], result["guidance.q_DN"][1:]))  # fmt: skip
    error, reference = ref.inv() * S, np.array(result["guidance.omega_DN_D"][1:])
    e = np.sin(error.magnitude() / 2)[:, None] * error.as_rotvec()
    e /= error.magnitude()[:, None]
    rate = result["servicer.omega_SN_S"][:-1] - error.inv().apply(reference)
    assert np.abs(result["controller.M_cmd_S"]).max() > 0.1
    assert result["controller.M_cmd_S"][1:] == pytest.approx(-K * e - D * rate, abs=1e-6)


def test_unedited_it_meets_every_requirement_of_a_clear_approach(twins):
    swap = {"controller": twins[0] / "my_pd.fmu"}
    result = run("sync_approach", params="clear", swap=swap, every=10)
    assert {f.verdict for f in findings(result)} == {Verdict.MET}


@each("port", ["F_cmd_S", "M_cmd_S"])
def test_its_twin_in_python_commands_the_same(twins, port):
    c, python = (
        simulate_case("sync_approach.controller", t, 2.0)[f"controller.{port}"] for t in twins
    )
    assert np.abs(c).max() > 0.01
    assert python == pytest.approx(c, abs=1e-9)


@pytest.mark.parametrize(
    ("place", "language", "stop"),
    [
        pytest.param("space_robot.joints", "c", 10.0, marks=pytest.mark.long),
        ("relay_approach.controller", "python", 1.0),
        ("sync_approach.guidance", "c", 1.0),
        pytest.param("arch_rendezvous.controller", "c", 1.0, marks=pytest.mark.long),
    ],
)
def test_anywhere_else_all_ports_are_there_and_outputs_stay_at_the_start(
    tmp_path, place, language, stop
):
    created = new_component("mine", "controller", language, place, tmp_path)
    build(created.folder)
    there = {
        (s.name, s.causality, s.shape)
        for s in show(created.folder / "mine.fmu").rows
        if s.causality != "parameter"
    }
    assert there == ports(place)
    result = simulate_case(place, created.folder, stop)
    component = place.split(".")[1]
    for name, causality, _ in ports(place):
        if causality == "output":
            values = result[f"{component}.{name}"]
            assert np.array_equal(values, np.broadcast_to(values[0], values.shape))
            if (
                name == "q_DN"
            ):  # the reference of an empty guidance: what the controller starts with
                assert values[-1].tolist() == [1, 0, 0, 0]


def test_the_readme_names_the_commands_that_were_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "controller", "mine", "--for", "space_robot.joints"]) == 0
    printed = [line.strip() for line in capsys.readouterr().out.splitlines()[1:]]
    page = Path("mine/README.md").read_text()
    assert printed == [
        "harness build mine",
        "harness run space_robot --swap joints=mine -o mine/mine.nc",
    ]
    assert all(f"    {command}\n" in page for command in printed)


def test_a_compiler_may_have_arguments_and_an_fmu_another_file_name(twins, tmp_path):
    """Also an argument that holds a blank: without both the file does not compile. The binary has
    the name of the file, where it is looked for.
    """
    source, other = tmp_path / "renamed.c", tmp_path / "deep" / "other.fmu"
    text = "#if SIX != 6 || SUM != 1 + 1\n#error arguments are lost\n#endif\n"
    source.write_bytes((twins[0] / "my_pd.c").read_bytes() + text.encode())
    with pytest.raises(HarnessError, match="arguments are lost"):
        build(source)
    assert build_path(source, other, compiler="cc -DSIX=6 '-DSUM=1 + 1'") == other
    assert run("sync_approach", swap={"controller": other}, stop=0.1).complete


# ---- errors


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["new", "controller", "2nd"], "2nd: a controller is named by a letter, then"),
        (["new", "controller", "ünder"], "ünder: a controller is named by a letter, then"),
        (["new", "controller", "lambda"], "lambda: a controller is named by a letter, then"),
        (["new", "controller", "target"], "target: the name is taken"),
        (
            ["new", "controller", "a", "--for", "controller"],
            "--for controller: expected SYSTEM.comp",
        ),
        (["new", "controller", "a", "--for", "sync_approach"], "--for sync_approach: expected SYS"),
        (
            ["new", "controller", "a", "--for", "sync_approach.ctrl"],
            "sync_approach has no component ctrl",
        ),
        (["new", "controller", "a", "--language", "rust"], "Invalid value for '--language'"),
        (["new", "robot", "a"], "new robot: expected `harness new controller|sensor|plant|mission"),
        (
            ["new", "sensor", "a", "--language", "python"],
            "new sensor --language python: needs --for SYSTEM.component",
        ),
        (
            ["build", "nothing"],
            "nothing: expected an existing .c or .py file, policy .npz or .onnx, or folder",
        ),
        (
            ["build", "empty"],
            "empty: expected an existing .c or .py file, policy .npz or .onnx, or folder",
        ),
        (["build", "both"], "both: contains both.c and both.py; name one file"),
        (["build", "bad.c", "-o", "x.so"], "--output x.so: expected a file NAME.fmu"),
        (["build", "bad.c", "--cc", "no_such_cc"], "no_such_cc: there is no such C compiler"),
        (["build", "bad.c", "--cc", ""], "(nothing): there is no such C compiler"),
        (["build", "bad.c", "--cc", "cc '-DX"], "--cc cc '-DX: is not a command (No closing quot"),
        (
            ["run", "sync_approach", "--swap", "controller=empty"],
            "empty: contains no empty.fmu; build it: harness build empty",
        ),
    ],
)
def test_wrong_use_exits_with_status_2_and_one_line(tmp_path, monkeypatch, capsys, arguments, line):
    monkeypatch.chdir(tmp_path)
    for folder in ("empty", "both"):
        Path(folder).mkdir()
    for file in ("bad.c", "both/both.c", "both/both.py"):
        Path(file).write_text("")
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"harness: {line}")
    assert err.count("\n") == 1


def test_nothing_that_exists_is_overwritten(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(HarnessError, match="mine: already exists"):
        new_component("mine", folder=tmp_path)
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_mistake_in_c_is_reported_in_the_words_of_the_compiler_and_retains_the_last_fmu(
    twins, tmp_path
):
    folder = Path(shutil.copytree(twins[0], tmp_path / "my_pd"))
    before = (folder / "my_pd.fmu").read_bytes()
    source = folder / "my_pd.c"
    source.write_text(source.read_text().replace("p->K", "p->KK"))
    with pytest.raises(HarnessError, match=r"(?s)my_pd\.c does not build:.*KK"):
        build(folder)
    assert (folder / "my_pd.fmu").read_bytes() == before


@pytest.mark.parametrize(
    ("before", "reported"),
    [
        (b"", "must begin with a comment /* ... */: equations and their source"),
        pytest.param(
            b"/* 5 \xb5m */\n",
            "must be text in UTF-8 (invalid start byte at byte 5)",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_file_that_cannot_be_documented_is_reported_in_one_line(tmp_path, before, reported):
    source = new_component("mine", folder=tmp_path).source
    code = re.sub(rb"(?s)\A(/\*.*?\*/\n)+", b"", source.read_bytes())
    assert not code.startswith(b"/*")
    source.write_bytes(before + code)
    with pytest.raises(HarnessError) as caught:
        build(source)
    assert str(caught.value) == f"{source} does not build: mine.c: {reported}"


def test_a_mistake_in_the_table_of_variables_is_reported(tmp_path):
    created = new_component("mine", folder=tmp_path)
    created.source.write_text(created.source.read_text().replace('"N/m"', '"furlong"'))
    with pytest.raises(HarnessError, match=r"(?s)does not build:.*furlong: unknown unit"):
        build(created.folder)


def test_a_mistake_in_python_is_reported(tmp_path):
    (tmp_path / "mine.py").write_text("import nothing_of_this_name\n")
    with pytest.raises(HarnessError, match=r"(?s)mine\.py does not build:.*nothing_of_this_name"):
        build(tmp_path / "mine.py")


def test_without_pythonfmu_the_extra_is_named(tmp_path, monkeypatch):
    created = new_component("mine", language="python", folder=tmp_path)
    monkeypatch.setattr(building.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(HarnessError, match="needs PythonFMU: pip install pythonfmu"):
        build(created.folder)


@given(name=st.one_of(st.text(max_size=8), st.from_regex(r"[A-Za-z_0-9]{1,4}", fullmatch=True)))
def test_a_name_is_an_identifier_of_a_folder_of_its_own_or_rejected(tmp_path, name):
    inside = {path.name for path in tmp_path.iterdir()}
    try:
        created = new_component(name, place="space_robot.joints", folder=tmp_path)
    except HarnessError as error:
        assert str(error)
        assert {path.name for path in tmp_path.iterdir()} == inside
    else:
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name)
        assert not keyword.iskeyword(name)
        assert created.folder == tmp_path / name
        assert name not in paths.fmus()


@pytest.mark.parametrize("place", [None, "space_robot.joints"])
def test_an_fmu_in_python_is_conforming(tmp_path, place):
    """Outputs are calculated, so FMI 2.0 requires them among the InitialUnknowns."""
    pytest.importorskip("pythonfmu")
    created = new_component("mine", "controller", "python", place, tmp_path)
    path = build(created.folder)
    assert check(str(path), strict=True).warnings == ()
    with zipfile.ZipFile(path) as file:
        root = ElementTree.fromstring(file.read("modelDescription.xml"))
    outputs, initial = (
        [e.get("index") for e in root.find(f"ModelStructure/{name}")]
        for name in ("Outputs", "InitialUnknowns")
    )
    assert outputs == initial
    assert len(outputs) == len(read_interface(path).named("output")) > 0
    assert re.fullmatch(r"\{.+\}", root.get("guid"))


def test_the_readme_names_the_next_commands_and_where_attitude_control_begins(tmp_path):
    text = (new_component("mine", folder=tmp_path).folder / "README.md").read_text()
    assert f"harness compare sync_approach --swap controller={tmp_path}/mine,adaptive" in text
    assert f"harness report {tmp_path}/mine/mine.nc -o {tmp_path}/mine/mine.html" in text
    assert f"harness check {tmp_path}/mine/mine.fmu --strict" in text
    assert "frozen until `servicer.t_att`" in text
    other = new_component("other", place="space_robot.joints", folder=tmp_path).folder / "README.md"
    assert "t_att" not in other.read_text()
    assert "harness compare space_robot --swap joints=" in other.read_text()
