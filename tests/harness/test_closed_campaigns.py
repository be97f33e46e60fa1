# SPDX-License-Identifier: BSD-2-Clause
"""Nobody can reach a campaign of this machine, nobody enters one elsewhere who has not got its
credentials, and nothing of it stays behind a kill.
"""

from __future__ import annotations

import os
import shutil
import ssl
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
import pytest
from dask import config
from distributed.security import Security

from harness import campaign
from harness.errors import UsageError
from harness.studies.campaign.clusters import Workers
from tests.harness import intruder
from tests.harness.interrupts import LONGEST, start, until

NOBODY = 65534
ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
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

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and users of POSIX")


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
def foreign(tmp_path_factory):
    """Key and certificate of somebody else, made as those of a campaign are."""
    folder = tmp_path_factory.mktemp("foreign")
    theirs = Security.temporary()
    (folder / "key.pem").write_text(theirs.tls_client_key)
    (folder / "cert.pem").write_text(theirs.tls_client_cert)
    return [str(folder / "key.pem"), str(folder / "cert.pem")]


def intrude(host, ports, foreign, user="-", before=()):
    """Doors that are open to an intruder; before: the command that puts it elsewhere."""
    script = Path(intruder.__file__).read_text()
    given = [host, ",".join(map(str, ports)), str(user), *foreign]
    ended = subprocess.run(
        [*before, sys.executable, "-I", "-c", script, *given],
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    *doors, last = ended.stdout.splitlines() or [""]
    assert last == f"tried {given[1]}", ended.stderr
    return doors


@pytest.fixture(scope="module")
def flying(tmp_path_factory):
    """A campaign with two workers under way: its process, its folder and its temporary folder."""
    folder = tmp_path_factory.mktemp("flying")
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


def test_nobody_can_reach_a_campaign_of_this_machine(flying):
    """There is no port, and what lies in files is ours alone."""
    process, _, temporary = flying
    assert len(family(process.pid)) > 3
    assert listening(process.pid) == set()
    kept = [path for path in temporary.iterdir() if path.is_dir()]
    assert kept
    for path in kept:
        assert (path.stat().st_mode & 0o077, path.stat().st_uid) == (0, os.geteuid())


def test_credentials_pass_the_strictest_check_and_those_of_another_campaign_none():
    """As Python 3.13 checks by default."""
    mine, theirs = Security.temporary(), Security.temporary()
    assert shaken(mine, mine) == "TLSv1.3"
    for server, client in ((mine, theirs), (theirs, mine)):
        with pytest.raises(ssl.SSLCertVerificationError):
            shaken(server, client)


def shaken(server, client):
    """The version of TLS that a scheduler and a client agree on, in memory."""
    ends = []
    for security, who in ((server, "scheduler"), (client, "client")):
        arguments = {"scheduler": security.get_listen_args, "client": security.get_connection_args}
        context = arguments[who](who)["ssl_context"]
        context.verify_flags |= ssl.VERIFY_X509_STRICT
        reads, writes = ssl.MemoryBIO(), ssl.MemoryBIO()
        ends.append(
            (context.wrap_bio(reads, writes, server_side=who == "scheduler"), reads, writes)
        )
    (one, to_one, from_one), (other, to_other, from_other) = ends
    for _ in range(4):
        for end in (other, one):
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
            to_one.write(from_other.read())
            to_other.write(from_one.read())
    assert one.version() == other.version()
    return other.version()


def test_a_kill_leaves_no_line_in_the_terminal_and_nothing_behind(flying):
    """The last test of this campaign."""
    process, _, temporary = flying
    everybody = family(process.pid)
    assert len(everybody) > 3
    assert any(temporary.iterdir())
    process.kill()
    output, errors = process.communicate(timeout=LONGEST)
    assert (output, errors) == ("", "")
    until(lambda: not any(map(lives, everybody)), "end of all")
    until(lambda: not any(temporary.iterdir()), "empty folder")


# ---- schedulers that are there


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    """Files of an authority: certificate, and one certificate with its key for everybody."""
    folder = tmp_path_factory.mktemp("ours")
    security = Security.temporary()
    (folder / "ca.pem").write_text(security.tls_ca_file)
    (folder / "me.pem").write_text(security.tls_client_cert)
    (folder / "me.key").write_text(security.tls_client_key)
    return {
        "tls_ca": folder / "ca.pem",
        "tls_cert": folder / "me.pem",
        "tls_key": str(folder / "me.key"),
    }


@pytest.fixture
def scheduler():
    """Starts schedulers with a worker each, in threads of ours; gives their addresses."""
    from distributed import LocalCluster

    with ExitStack() as life:

        def begin(files=None):
            security = Workers(0, None, True, *files).credentials() if files else None
            cluster = LocalCluster(
                n_workers=1,
                threads_per_worker=1,
                processes=False,
                protocol="tls://" if files else "tcp://",
                security=security,
                dashboard_address="127.0.0.1:0",
                silence_logs=50,
            )
            return life.enter_context(cluster).scheduler_address

        yield begin


def test_a_scheduler_that_everybody_may_enter_is_accepted_by_an_option_only(
    tmp_path, scheduler, foreign
):
    address, said = scheduler(), []
    host, port = address.removeprefix("tcp://").split(":")
    assert f"{port} speaks to everybody" in intrude(host, [port], foreign)  # it sees open doors
    given = definition(tmp_path, 3)
    with pytest.raises(UsageError) as caught:
        campaign(given, tmp_path / "out.zarr", scheduler=address)
    assert str(caught.value) == (
        f"--scheduler {address}: without TLS anybody on the network may run code as this user; "
        "name credentials of the cluster with --tls-ca, --tls-cert and --tls-key (or in the "
        "configuration of Dask), or accept it with --insecure"
    )
    assert not (tmp_path / "out.zarr").exists()
    done = campaign(
        given, tmp_path / "out.zarr", scheduler=address, insecure=True, said=said.append
    )
    assert done.store.array("status").tolist() == [1, 1, 1]
    assert said == [f"{address}: without TLS anybody on the network may run code as this user"]


def test_a_scheduler_under_tls_takes_credentials_that_the_user_names(
    tmp_path, scheduler, ours, foreign, monkeypatch
):
    address, said = scheduler(ours.values()), []
    host, port = address.removeprefix("tls://").split(":")
    assert intrude(host, [port], foreign) == []
    given = definition(tmp_path, 3)
    done = campaign(
        given, tmp_path / "a.zarr", scheduler=f"{host}:{port}", said=said.append, **ours
    )
    assert done.store.array("status").tolist() == [1, 1, 1]
    names = {"ca-file": "tls_ca", "client.cert": "tls_cert", "client.key": "tls_key"}
    known = {f"distributed.comm.tls.{name}": str(ours[key]) for name, key in names.items()}
    with config.set(known):
        campaign(given, tmp_path / "b.zarr", scheduler=address, said=said.append)
    assert said == []
    theirs = {"tls_ca": foreign[1], "tls_cert": foreign[1], "tls_key": foreign[0]}
    with pytest.raises(UsageError, match=rf"--scheduler {address}: refuses the credentials"):
        campaign(given, tmp_path / "c.zarr", scheduler=address, **theirs)


PEM = "expected PEM files, the certificate of the authority, an own one, and its key if it is apart"


@pytest.mark.parametrize(
    ("how", "line"),
    [
        (
            {"scheduler": "tcp://there:8786", "tls_ca": "ca", "tls_cert": "me", "tls_key": "key"},
            "--scheduler tcp://there:8786: is an address without TLS, and credentials are named",
        ),
        (
            {"scheduler": "there:8786", "tls_ca": "ca"},
            f"--tls-ca ca: {PEM} (one is missing)",
        ),
        (
            {"scheduler": "there:8786", "tls_ca": "ca", "tls_cert": "none.pem"},
            f"--tls-ca ca --tls-cert none.pem: {PEM} ([Errno 2] No such file or directory)",
        ),
        (
            {"scheduler": "there:8786", "tls_ca": "ca", "tls_cert": "me", "tls_key": "odd"},
            f"--tls-ca ca --tls-cert me --tls-key odd: {PEM} ([SSL] PEM lib (_ssl.c:",
        ),
        (
            {"insecure": True},
            "--insecure: is for --scheduler, nothing else goes without TLS",
        ),
        (
            {"tls_cert": "me"},
            "--tls-ca: is for --scheduler and --slurm, workers here need none",
        ),
        ({"scheduler": "there:8786", "slurm": True}, "--scheduler and --slurm: one of both"),
    ],
)
def test_what_contradicts_itself_is_refused_before_anything_starts(tmp_path, ours, how, line):
    for name, file in zip(("ca", "me", "key"), ours.values(), strict=True):
        shutil.copy(file, name)
    Path("odd").write_text("no key")
    with pytest.raises(UsageError) as caught:
        campaign(definition(tmp_path, 3), tmp_path / "out.zarr", **how)
    assert str(caught.value).startswith(line)


# ---- SLURM

SBATCH = """#!/bin/sh
# a job is a process of its own here
cp "$1" "{folder}/job.sh"  # the script goes at once
setsid sh "{folder}/job.sh" > "{folder}/job.log" 2>&1 < /dev/null &
echo $! >> "{folder}/jobs"
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
kill -- "-$1"
"""


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """A machine on which jobs are submitted: sbatch and scancel that start and end processes."""
    pytest.importorskip("dask_jobqueue")
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (folder / name).write_text(text.format(folder=folder))
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", ENVIRONMENT["PYTHONPATH"])
    return folder


def test_jobs_of_slurm_are_handed_credentials_in_a_folder_of_ours(slurm, tmp_path, foreign):
    """The scheduler is there for the whole network."""
    seen = {}

    def look(_):
        if not seen:
            (job,) = map(int, (slurm / "jobs").read_text().split())
            (folder,) = Path.cwd().glob("harness-*")
            files = [file for file in folder.iterdir() if file.is_file()]
            text = " ".join(" ".join(p.cmdline()) for p in family(job))
            seen["mode"] = folder.stat().st_mode & 0o777
            seen["told"] = {name for name in ("ca-file", "cert", "key") if f"--tls-{name} " in text}
            seen["files"] = [file.stat().st_mode & 0o077 for file in files]
            doors = sorted(listening(os.getpid()) | listening(job))
            seen["open"] = [d for at, port in doors for d in intrude(local(at), [port], foreign)]
            seen["several"] = len(doors) >= 3  # of a scheduler, a keeper and a worker

    given = definition(tmp_path, 3)
    done = campaign(given, tmp_path / "out.zarr", slurm=True, workers=1, progress=look)
    assert done.store.array("status").tolist() == [1, 1, 1]
    assert seen == {
        "mode": 0o700,
        "told": {"ca-file", "cert", "key"},
        "files": [0, 0],
        "open": [],
        "several": True,
    }
    assert list(Path.cwd().glob("harness-*")) == []
    assert "#SBATCH --mem=2G" in (slurm / "job.sh").read_text()


def local(host):
    """An address of this machine on which somebody listens who listens everywhere."""
    return "127.0.0.1" if host in ("0.0.0.0", "::") else host
