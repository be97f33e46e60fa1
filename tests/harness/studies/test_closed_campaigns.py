# SPDX-License-Identifier: BSD-2-Clause
"""No client reaches a campaign, and it leaves nothing behind after a kill."""

from __future__ import annotations

import os
import subprocess
import sys

import psutil
import pytest

from tests.harness.interrupts import LONGEST, start, until

ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}

CAMPAIGN = """
system = "space_robot"
runs = {runs}
[fixed]
stop = 20.0
[factors]
"robot.e" = {{uniform = {{low = 0.1, high = 0.3}}}}
[metrics]
rate = "max(norm(robot.omega_SN_S))"
"""

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def definition(folder, runs):
    (folder / "c.toml").write_text(CAMPAIGN.format(runs=runs))
    return folder / "c.toml"


def family(pid):
    parent = psutil.Process(pid)
    return [parent, *parent.children(recursive=True)]


def lives(process):
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


def listening(pid):
    """Addresses and ports that a process and all it has started listen on."""
    found = set()
    for process in family(pid):
        try:
            lines = process.net_connections("tcp")
        except psutil.Error:  # it has gone meanwhile
            continue
        found |= {tuple(line.laddr) for line in lines if line.status == psutil.CONN_LISTEN}
    return found


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A campaign with two workers under way: its process, its folder and its temporary folder."""
    folder = tmp_path_factory.mktemp("running")
    temporary = tmp_path_factory.mktemp("temporary")
    definition(folder, 100_000)
    process = start(
        [sys.executable, "-m", "harness", "campaign", "c.toml", "-o", "c.zarr", "--workers", "2"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT | {"TMPDIR": str(temporary)},
    )
    until((folder / "c.zarr" / "status" / "c" / "0").exists, "first block")
    try:
        yield process, folder, temporary
    finally:
        process.kill()
        process.communicate()


def test_no_one_can_reach_a_campaign(running):
    """There is no port, and what lies in files is ours alone."""
    process, _, temporary = running
    assert len(family(process.pid)) > 3
    assert listening(process.pid) == set()
    retained = [path for path in temporary.iterdir() if path.is_dir()]
    assert retained
    for path in retained:
        assert (path.stat().st_mode & 0o077, path.stat().st_uid) == (0, os.geteuid())


def test_a_kill_leaves_no_line_in_the_terminal_and_nothing_behind(running):
    """The last test of this campaign."""
    process, _, temporary = running
    everybody = family(process.pid)
    assert len(everybody) > 3
    assert any(temporary.iterdir())
    process.kill()
    output, errors = process.communicate(timeout=LONGEST)
    assert (output, errors) == ("", "")
    until(lambda: not any(map(lives, everybody)), "end of all")
    until(lambda: not any(temporary.iterdir()), "empty folder")
