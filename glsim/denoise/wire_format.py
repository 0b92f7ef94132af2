"""Reads the wire format of Protocol Buffers, in which ONNX files are written.

Source: protobuf.dev/programming-guides/encoding.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple


class Field(NamedTuple):
    """A field of a message: its number, and an integer or the bytes of a text or message."""

    number: int
    integer: int
    data: memoryview


def fields(message: memoryview) -> Iterator[Field]:
    """Yield the fields of a message. Raises ValueError if it is cut short or no message."""
    nothing = memoryview(b"")
    at = 0
    while at < len(message):
        key, at = varint(message, at)
        wire = key & 7
        if key < 8:  # no field has number 0; a file of zeros would be millions of them
            raise ValueError("is damaged")
        if wire == 0:
            value, at = varint(message, at)
            yield Field(key >> 3, value, nothing)
            continue
        if wire == 2:
            length, at = varint(message, at)
        elif wire in (1, 5):
            length = 8 if wire == 1 else 4
        else:
            raise ValueError("is damaged")
        if length > len(message) - at:
            raise ValueError("is cut short")
        yield Field(key >> 3, 0, message[at : at + length] if wire == 2 else nothing)
        at += length


def varint(message: memoryview, at: int) -> tuple[int, int]:
    """Return an integer in seven bits a byte, and the place behind it."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("is cut short")
        byte = message[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value & (2**64 - 1), at
    raise ValueError("is damaged")


def integers(field: Field) -> list[int]:
    """Return one integer, or the packed ones of a repeated field, with their signs."""
    if not field.data:
        return [_signed(field.integer)]
    found, at = [], 0
    while at < len(field.data):
        value, at = varint(field.data, at)
        found.append(_signed(value))
    return found


def _signed(value: int) -> int:
    return value - 2**64 if value >= 2**63 else value
