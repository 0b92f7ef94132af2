"""A lock in object storage: an object that only one of several processes can create.

A store frees nothing when a process dies. Its holder therefore writes the object again and again,
and another process that sees it unchanged for a while takes it over. No clocks are compared. Two
holders at once would do no harm, for both write the same bytes; the lock saves their work.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from glsim.errors import DatasetError, GlsimError
from glsim.files.cloud import CloudFolder

log = logging.getLogger(__name__)

#: Seconds between two signs of life of the holder, and without one until the lock is free: three
#: signs may be lost to a store that is throttled.
BEAT_S, EXPIRES_S = 10.0, 45.0
_POLL_S = 1.0
_MAX_BYTES = 4096


@contextmanager
def object_lock(
    cloud: CloudFolder, name: str, busy: GlsimError, *, wait: bool = False
) -> Iterator[None]:
    """Hold the lock ``name`` for a block.

    Args:
        cloud: the folder of the lock.
        name: its object.
        busy: raised, with the holder's name, if another process holds it.
        wait: wait for the holder instead.
    """
    token, beat = secrets.token_hex(8), 0

    def content() -> bytes:
        words = {"host": socket.gethostname(), "pid": os.getpid(), "token": token, "beat": beat}
        return json.dumps(words).encode()

    while not cloud.write_new(name, content()):
        found = cloud.read(name, _MAX_BYTES)
        if found is None:
            continue  # freed just now
        if token in found.decode(errors="replace"):
            break  # it was written, and the answer was lost
        if _is_abandoned(cloud, name, found):
            cloud.delete([name])
        elif not wait:
            raise type(busy)(f"{busy} (it is {_holder(found)})")
    ended = threading.Event()

    def show_life() -> None:
        nonlocal beat
        while not ended.wait(BEAT_S):
            beat += 1
            with suppress(DatasetError):  # the next one may arrive
                cloud.write(name, content())

    thread = threading.Thread(target=show_life, name="lock", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        with suppress(DatasetError):  # it expires
            if token in (cloud.read(name, _MAX_BYTES) or b"").decode(errors="replace"):
                cloud.delete([name])


def _is_abandoned(cloud: CloudFolder, name: str, seen: bytes) -> bool:
    """Watch a lock until it changes (False) or has expired (True)."""
    if _died_here(seen):
        return True
    log.warning(
        "%s: %s holds the lock: waiting up to %.0f s to see whether it lives",
        cloud, _holder(seen), EXPIRES_S,
    )  # fmt: skip
    started = time.monotonic()
    while time.monotonic() - started < EXPIRES_S:
        time.sleep(min(_POLL_S, EXPIRES_S))
        if cloud.read(name, _MAX_BYTES) != seen:
            return False
    return True


def _died_here(content: bytes) -> bool:
    """Return whether the holder was a process of this machine that is gone."""
    try:
        words = json.loads(content)
        if words["host"] != socket.gethostname():
            return False
        os.kill(int(words["pid"]), 0)
    except ProcessLookupError:
        return True
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError, PermissionError):
        return False
    return False


def _holder(content: bytes) -> str:
    try:
        words = json.loads(content)
        return f"process {int(words['pid'])} on {str(words['host'])[:100]}"
    except (ValueError, TypeError, KeyError, RecursionError):
        return "an unknown process"
