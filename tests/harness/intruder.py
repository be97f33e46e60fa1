# SPDX-License-Identifier: BSD-2-Clause
"""Client that reaches the ports of a campaign and has no credentials: any answer is a door.

    python -I -c INTRUDER HOST PORTS USER KEY CERTIFICATE

prints the doors that are open, a line each. Ports are given side by side, USER is a number or -. It
knows the standard library only, and loads all before it becomes another user.
"""

import encodings.idna  # noqa: F401 - names of hosts need it
import os
import socket
import ssl
import sys

ALERT = 21
"""First byte of a TLS record that rejects."""


def heard(host: str, port: int, sent: bytes) -> bytes:
    """Return the answer of a port to plain bytes."""
    with socket.create_connection((host, port), timeout=5) as line:
        line.sendall(sent)
        line.settimeout(1)
        try:
            return line.recv(100)
        except OSError:
            return b""


def heard_under_tls(host: str, port: int, context: ssl.SSLContext) -> bytes:
    """Return the answer of a port to a client that does not authenticate it.

    Dask's nodes send first, as soon as they accept a client.
    """
    try:
        with (
            socket.create_connection((host, port), timeout=5) as line,
            context.wrap_socket(line) as secret,
        ):
            return secret.recv(100)
    except OSError:  # ssl.SSLError among them
        return b""


def client(*files: str) -> ssl.SSLContext:
    """Return a TLS context that trusts every peer; files: certificate and key to show."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    if files:
        context.load_cert_chain(*files)
    return context


def doors(host, port, nameless, third_party):
    """Yield what is open behind a port."""
    try:
        plain = heard(host, port, b"")
        page = heard(host, port, b"GET / HTTP/1.0\r\n\r\n")
    except OSError:
        return  # nothing listens for us
    if plain and plain[0] != ALERT:
        yield "answers everybody"
    if page.startswith(b"HTTP"):
        yield "serves pages"
    if heard_under_tls(host, port, nameless):
        yield "accepts who has no certificate"
    if heard_under_tls(host, port, third_party):
        yield "accepts third-party certificates"


def main(host: str, ports: str, user: str, key: str, certificate: str) -> None:
    """Try all doors."""
    nameless, third_party = client(), client(certificate, key)
    if user.isdigit():
        os.setgroups([])
        os.setgid(int(user))
        os.setuid(int(user))
    for port in map(int, ports.split(",")):
        for door in doors(host, port, nameless, third_party):
            print(port, door)
    print("tried", ports)


if __name__ == "__main__":
    main(*sys.argv[1:])
