# SPDX-License-Identifier: BSD-2-Clause
"""Who may enter the scheduler of a campaign: who holds a key of its certificate authority.

Whoever reaches a scheduler of Dask runs code as its user, and an address of this machine is reached
by every other user of it. All connections are therefore under TLS with certificates on both sides:
made for one campaign and forgotten with it, or named by the user.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from harness.errors import UsageError

OPEN = "without TLS anybody on the network may run code as this user"

SKEW, LIFE = timedelta(days=1), timedelta(days=365)
"""What the clocks of the nodes may differ by, and how long a campaign may take."""


class Files(NamedTuple):
    """Certificate of the authority, own certificate, its key (None: with the certificate), PEM."""

    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None


NONE = Files()


def made() -> Any:
    """New credentials for one campaign, in memory: a key and a certificate that it signs itself,
    the same for everybody.

    As Security.temporary() of Dask, with a key on the curve P-256 in place of RSA: it is made in
    0.2 ms instead of 60 ms of processor time, and every connection costs less.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from distributed.security import Security

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "campaign")])
    now = datetime.now(UTC)
    certificate = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - SKEW)
        .not_valid_after(now + LIFE)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(x509.KeyUsage), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(
        pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    ).decode()
    public = certificate.public_bytes(pem).decode()
    everybody = _of_all({"cert": public, "key": secret})
    return Security(require_encryption=True, tls_ca_file=public, **everybody)


def _usage(key_usage: Any) -> Any:
    """It signs the beginning of a connection, and itself."""
    further = (
        "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
        "crl_sign", "encipher_only", "decipher_only",
    )  # fmt: skip
    return key_usage(digital_signature=True, key_cert_sign=True, **dict.fromkeys(further, False))


def made_in(folder: Path) -> Any:
    """New credentials for one campaign, in files of a folder that only this user may enter."""
    from distributed.security import Security

    security = made()
    texts = {"ca": security.tls_ca_file, "cert": security.tls_client_cert}
    for name, text in {**texts, "key": security.tls_client_key}.items():
        (folder / f"{name}.pem").write_text(text)
        (folder / f"{name}.pem").chmod(0o600)
    paths = {name: str(folder / f"{name}.pem") for name in ("ca", "cert", "key")}
    return Security(require_encryption=True, tls_ca_file=paths["ca"], **_of_all(paths))


def _of_all(files: Mapping[str, str | None]) -> dict[str, str | None]:
    """The same certificate and key for everybody in a cluster of Dask."""
    everybody = ("client", "scheduler", "worker")
    return {f"tls_{who}_{what}": files[what] for who in everybody for what in ("cert", "key")}


def named(files: Files) -> Any:
    """Credentials from files, else from the configuration of Dask; None if there are none.

    Raises UsageError (a file is missing, damaged, or not of the others).
    """
    from distributed.security import Security

    if any(files):
        return _read(files)
    known: Any = Security()
    if not (known.tls_ca_file and known.tls_client_cert):
        return None
    known.require_encryption = True
    return _usable(known, "the configuration of Dask, distributed.comm.tls")


def _read(files: Files) -> Any:
    from distributed.security import Security

    if files.ca is None or files.cert is None:
        raise UsageError("--tls-ca and --tls-cert belong together, with --tls-key if it is a file")
    for option, file in files._asdict().items():
        if file is not None and not file.is_file():
            raise UsageError(f"--tls-{option} {file}: no such file")
    given = {option: f and str(f.absolute()) for option, f in files._asdict().items()}
    words = " ".join(f"--tls-{option} {f}" for option, f in files._asdict().items() if f)
    security = Security(require_encryption=True, tls_ca_file=given["ca"], **_of_all(given))
    return _usable(security, words)


def _usable(security: Any, words: str) -> Any:
    """Credentials that can be loaded."""
    try:
        security.get_connection_args("client")
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        raise UsageError(f"{words}: must be PEM certificates and the key of the second") from error
    return security


def of_scheduler(address: str, files: Files, insecure: bool) -> Any:
    """Credentials for a scheduler that is there, None: without any, which the user has accepted.

    Raises UsageError.
    """
    security = named(files)
    if security is None and not insecure:
        raise UsageError(
            f"--scheduler {address}: {OPEN}; name credentials of the cluster with --tls-ca, "
            "--tls-cert and --tls-key (or in the configuration of Dask), or accept it with "
            "--insecure"
        )
    if security is not None and address.partition("://")[0] in ("tcp", "ws"):
        raise UsageError(
            f"--scheduler {address}: is an address without TLS, and credentials are named; "
            f"tls://{address.partition('://')[2]}"
        )
    return security
