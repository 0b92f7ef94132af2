"""Who is at the other end of a connection from this machine: the user of its socket."""

from __future__ import annotations

import ipaddress
import socket
import struct
from collections.abc import Sequence
from pathlib import Path

_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))


def peer_uid(peer: Sequence[object] | None, port: int) -> int | None:
    """Return the user of the process that connected from this machine.

    A cookie is sent to all ports of a host, those of other users too, so that it alone does not
    tell users apart.

    Args:
        peer: address and port of the other end.
        port: of this end.

    Returns:
        None if the system does not say, as for a peer on another machine.
    """
    if peer is None:
        return None
    try:
        wanted = ipaddress.ip_address(str(peer[0])), int(str(peer[1]))
    except ValueError:
        return None
    for table in _TABLES:
        try:
            lines = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:  # not Linux
            continue
        for line in lines:
            words = line.split()
            here, there = _end(words[1]), _end(words[2])
            if there[1] == port and here[1] == wanted[1] and _same(here[0], wanted[0]):
                return int(words[7])
    return None


_Ip = ipaddress.IPv4Address | ipaddress.IPv6Address


def _end(text: str) -> tuple[_Ip, int]:
    """Read an address and a port as the kernel prints them: words in the machine's byte order."""
    address, port = text.split(":")
    words = [int(address[n : n + 8], 16) for n in range(0, len(address), 8)]
    packed = struct.pack(f"={len(words)}I", *words)
    family = socket.AF_INET if len(words) == 1 else socket.AF_INET6
    return ipaddress.ip_address(socket.inet_ntop(family, packed)), int(port, 16)


def _same(first: _Ip, second: _Ip) -> bool:
    """Whether two addresses are the same; IPv4 may be written within IPv6."""
    plain = [getattr(one, "ipv4_mapped", None) or one for one in (first, second)]
    return plain[0] == plain[1]
