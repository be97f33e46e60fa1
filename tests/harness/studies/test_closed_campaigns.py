# SPDX-License-Identifier: BSD-2-Clause
"""No client reaches a campaign of this machine, none enters one elsewhere without its credentials,
and it leaves nothing behind after a kill.
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
def third_party(tmp_path_factory):
    """Key and certificate of a third party, made as a campaign makes its own."""
    folder = tmp_path_factory.mktemp("third_party")
    theirs = Security.temporary()
    (folder / "key.pem").write_text(theirs.tls_client_key)
    (folder / "cert.pem").write_text(theirs.tls_client_cert)
    return [str(folder / "key.pem"), str(folder / "cert.pem")]


def intrude(host, ports, third_party, user="-", before=()):
    """Doors that are open to an intruder; before: the command that puts it elsewhere."""
    script = Path(intruder.__file__).read_text()
    given = [host, ",".join(map(str, ports)), str(user), *third_party]
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


def test_no_one_can_reach_a_campaign_of_this_machine(running):
    """There is no port, and what lies in files is ours alone."""
    process, _, temporary = running
    assert len(family(process.pid)) > 3
    assert listening(process.pid) == set()
    retained = [path for path in temporary.iterdir() if path.is_dir()]
    assert retained
    for path in retained:
        assert (path.stat().st_mode & 0o077, path.stat().st_uid) == (0, os.geteuid())


def test_credentials_pass_the_strictest_check_and_other_credentials_none():
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
    tmp_path, scheduler, third_party
):
    address, reported = scheduler(), []
    host, port = address.removeprefix("tcp://").split(":")
    assert f"{port} answers everybody" in intrude(host, [port], third_party)  # it sees open doors
    given = definition(tmp_path, 3)
    with pytest.raises(UsageError) as caught:
        campaign(given, tmp_path / "out.zarr", scheduler=address)
    assert str(caught.value) == (
        f"--scheduler {address}: without TLS anybody on the network can run code as this user; "
        "give the credentials of the cluster with --tls-ca, --tls-cert and --tls-key (or in the "
        "configuration of Dask), or accept it with --insecure"
    )
    assert not (tmp_path / "out.zarr").exists()
    done = campaign(
        given, tmp_path / "out.zarr", scheduler=address, insecure=True, notify=reported.append
    )
    assert done.store.array("status").tolist() == [1, 1, 1]
    assert reported == [f"{address}: without TLS anybody on the network can run code as this user"]


def test_a_scheduler_under_tls_takes_credentials_that_the_user_names(
    tmp_path, scheduler, ours, third_party, monkeypatch
):
    address, reported = scheduler(ours.values()), []
    host, port = address.removeprefix("tls://").split(":")
    assert intrude(host, [port], third_party) == []
    given = definition(tmp_path, 3)
    done = campaign(
        given, tmp_path / "a.zarr", scheduler=f"{host}:{port}", notify=reported.append, **ours
    )
    assert done.store.array("status").tolist() == [1, 1, 1]
    names = {"ca-file": "tls_ca", "client.cert": "tls_cert", "client.key": "tls_key"}
    known = {f"distributed.comm.tls.{name}": str(ours[key]) for name, key in names.items()}
    with config.set(known):
        campaign(given, tmp_path / "b.zarr", scheduler=address, notify=reported.append)
    assert reported == []
    theirs = {"tls_ca": third_party[1], "tls_cert": third_party[1], "tls_key": third_party[0]}
    with pytest.raises(UsageError, match=rf"--scheduler {address}: rejects the credentials"):
        campaign(given, tmp_path / "c.zarr", scheduler=address, **theirs)


PEM = (
    "expected PEM files, the certificate of the authority, your own, and its key if it is in "
    "another file"
)


@pytest.mark.parametrize(
    ("how", "line"),
    [
        (
            {"scheduler": "tcp://there:8786", "tls_ca": "ca", "tls_cert": "me", "tls_key": "key"},
            "--scheduler tcp://there:8786: the address is without TLS, but credentials are "
            "given; use tls://HOST:PORT",
        ),
        (
            {"scheduler": "there:8786", "tls_ca": "ca"},
            f"--tls-ca ca: {PEM} (--tls-ca or --tls-cert is missing)",
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
            "--insecure is valid only with --scheduler",
        ),
        (
            {"tls_cert": "me"},
            "--tls-ca, --tls-cert and --tls-key are valid only with --scheduler or --slurm",
        ),
        (
            {"scheduler": "there:8786", "slurm": True},
            "--scheduler and --slurm are mutually exclusive",
        ),
    ],
)
def test_contradictory_options_are_rejected_before_anything_starts(tmp_path, ours, how, line):
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


def test_jobs_of_slurm_are_handed_credentials_in_a_folder_of_ours(slurm, tmp_path, third_party):
    """The scheduler is there for the whole network."""
    seen = {}

    def look(_):
        if not seen:
            (job,) = map(int, (slurm / "jobs").read_text().split())
            (folder,) = Path.cwd().glob("harness-*")
            files = [file for file in folder.iterdir() if file.is_file()]
            text = " ".join(" ".join(p.cmdline()) for p in family(job))
            seen["mode"] = folder.stat().st_mode & 0o777
            seen["tls"] = {name for name in ("ca-file", "cert", "key") if f"--tls-{name} " in text}
            seen["files"] = [file.stat().st_mode & 0o077 for file in files]
            doors = sorted(listening(os.getpid()) | listening(job))
            seen["open"] = [
                d for at, port in doors for d in intrude(local(at), [port], third_party)
            ]
            seen["several"] = len(doors) >= 3  # of a scheduler, a keeper and a worker

    given = definition(tmp_path, 3)
    done = campaign(given, tmp_path / "out.zarr", slurm=True, workers=1, progress=look)
    assert done.store.array("status").tolist() == [1, 1, 1]
    assert seen == {
        "mode": 0o700,
        "tls": {"ca-file", "cert", "key"},
        "files": [0, 0],
        "open": [],
        "several": True,
    }
    assert list(Path.cwd().glob("harness-*")) == []
    assert "#SBATCH --mem=2G" in (slurm / "job.sh").read_text()


def local(host):
    """An address of this machine on which a server that listens everywhere can be reached."""
    return "127.0.0.1" if host in ("0.0.0.0", "::") else host
