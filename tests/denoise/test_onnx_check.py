"""ONNX files are checked before a runtime takes memory for them or opens what they name."""

from __future__ import annotations

import importlib.resources
import struct
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from glsim.denoise import shipped
from glsim.denoise.onnx_check import check_onnx
from glsim.denoise.onnx_file import load_onnx
from glsim.errors import DenoiserError


def varint(value: int) -> bytes:
    value %= 2**64
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def field(number: int, value: bytes | str | int) -> bytes:
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def tensor(*shape: int, more: bytes = b"", kind: int = 1, raw: bytes = bytes(16)) -> bytes:
    return b"".join(field(1, side) for side in shape) + field(2, kind) + field(9, raw) + more


def node(
    operator: str,
    attribute: bytes = b"",
    domain: str = "",
    inputs: Sequence[str] = (),
    output: str = "",
) -> bytes:
    ends = b"".join(field(1, name) for name in inputs) + field(2, output)
    return ends + field(4, operator) + field(7, domain) + field(5, attribute)


def model(*graph: bytes, more: bytes = b"") -> bytes:
    return field(1, 8) + field(7, b"".join(graph)) + more


def whole(*values: int) -> bytes:
    return tensor(len(values), kind=7, raw=struct.pack(f"<{len(values)}q", *values))


def doubled(times: int, axis: int, operator: str = "Concat", start: str = "x") -> list[bytes]:
    """Nodes of Concat(x, x) of that, and so on; or of an operator with a constant input."""
    at = field(1, "axis") + field(3, axis) if operator == "Concat" else STRIDES
    names = [start, *(f"{operator}{axis}{n}" for n in range(times))]
    second = {"Resize": ["", "twice"], "ConvTranspose": ["up"], "MatMul": ["square"]}
    return [
        field(1, node(operator, at, "", [a, *second.get(operator, [a])], b))
        for a, b in pairwise(names)
    ]


SIDES = b"".join(field(1, field(1, side)) for side in (1, 1, 16, 16))
MAP = field(11, field(1, "x") + field(2, field(1, field(1, 1) + field(2, SIDES))))
TWICE = field(5, tensor(4, raw=struct.pack("<4f", 1, 1, 2, 2), more=field(8, "twice")))
UP = field(5, tensor(1, 1, 2, 2, more=field(8, "up")))
STRIDES = field(1, "strides") + field(8, 2) + field(8, 2)
SQUARE = field(5, tensor(1, 16, more=field(8, "square")))
SOUND = model(
    field(1, node("Conv", field(8, varint(3) * 2))),
    field(5, tensor(4)),
    field(5, whole(-1, 2**63 - 1)),
)
ENTRY = field(1, "location") + field(2, "../secret.bin")
BAD: dict[str, tuple[bytes, str]] = {
    "3,000 convolutions": (
        model(*[field(1, node("Conv"))] * 3000),
        "has 3000 convolutions and products, more than 1000",
    ),
    "external data": (
        model(field(5, tensor(4, more=field(13, ENTRY) + field(14, 1)))),
        "keeps weights in another file",
    ),
    "external data of a constant": (
        model(field(1, node("Constant", field(5, tensor(4, more=field(13, ENTRY)))))),
        "keeps weights in another file",
    ),
    "location alone": (model(field(5, tensor(4, more=field(14, 1)))), "in another file"),
    "a tensor of 10^18": (model(field(5, tensor(10**9, 10**9))), "holds a tensor of shape"),
    "a negative side": (model(field(5, tensor(-4))), "holds a tensor of shape"),
    "packed sides": (
        model(field(5, field(1, varint(10**6) * 2) + field(9, bytes(8)))),
        "holds a tensor of shape",
    ),
    "a shape to fill": (
        model(field(1, node("ConstantOfShape")), field(5, whole(8000, 8000, 8000))),
        "holds the shape",
    ),
    "a large number": (model(field(5, whole(10**6))), "holds the number 1000000"),
    "large pads": (model(field(1, node("Conv", field(8, 10**9)))), "holds the number"),
    "a loop": (model(field(1, node("Loop"))), "uses the operator 'Loop'"),
    "a foreign operator": (model(field(1, node("Conv", domain="evil"))), "'evil Conv'"),
    "a graph in a node": (model(field(1, node("Conv", field(6, b"")))), "a graph in a node"),
    "sparse": (model(field(15, b"")), "sparse"),
    "functions": (model(field(5, tensor(4)), more=field(25, b"x")), "functions"),
    "many nodes": (model(field(1, node("Add")) * 20_001), "has 20001 nodes"),
    "a map doubled twenty times": (
        model(MAP, *doubled(20, 1)),
        "makes 16384 numbers a pixel by Concat, more than 8192",
    ),
    "doubled below": (model(MAP, *doubled(20, -2)), "makes 16384 numbers a pixel by Concat"),
    "doubled in the batch": (model(MAP, *doubled(20, 0)), "makes 16384 numbers a pixel by Concat"),
    "magnified": (model(MAP, TWICE, *doubled(9, 0, "Resize")), "16384 numbers a pixel by Resize"),
    "transposed": (
        model(MAP, UP, *doubled(9, 0, "ConvTranspose")),
        "16384 numbers a pixel by ConvTranspose",
    ),
    "multiplied": (
        model(MAP, SQUARE, *doubled(9, 0, "MatMul")),
        "65536 numbers a pixel by MatMul",
    ),
    "channels and maps": (
        model(MAP, *doubled(13, 1), *doubled(1, 0, start="Concat112")),
        "16384 numbers a pixel by Concat",
    ),
    "out of order": (model(*doubled(2, 1)), "uses 'x' before it is made"),
    "no graph": (field(1, 8), "holds no graph"),
    "two graphs": (SOUND + SOUND, "several graphs"),
    "cut": (SOUND[:-3], "is cut short"),
    "endless number": (b"\xff" * 30, "is damaged"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_asks_for_memory_or_other_files_is_refused(name: str, tmp_path: Path) -> None:
    data, problem = BAD[name]
    check_onnx(SOUND)
    with pytest.raises(ValueError, match=problem):
        check_onnx(data)
    path = tmp_path / "net.onnx"
    path.write_bytes(data)
    with pytest.raises(DenoiserError, match=rf"net.onnx: .*{problem}"):
        load_onnx(path)


@pytest.mark.parametrize("name", ["face", "face-live", "face-stereo", "face-video"])
def test_the_shipped_networks_pass(name: str) -> None:
    check_onnx((importlib.resources.files(shipped) / f"{name}.onnx").read_bytes())


def test_halves_of_a_batch_are_no_wider() -> None:
    """``chunk`` cuts at places that are computed from the shape; 20 pairs are no 2^20 maps."""
    nodes, name = [], "x"
    for n in range(20):
        number = {i: f"{i}{n}" for i in ("pair", "shape", "batch", "half", "first")}
        axis = field(1, "axis") + field(3, 0)
        nodes += [
            node("Concat", axis, "", [name, name], number["pair"]),
            node("Shape", b"", "", [number["pair"]], number["shape"]),
            node("Gather", axis, "", [number["shape"], "zero"], number["batch"]),
            node("Div", b"", "", [number["batch"], "two"], number["half"]),
            node(
                "Slice", b"", "", [number["pair"], "zero", number["half"], "zero"], number["first"]
            ),
        ]
        name = number["first"]
    numbers = [
        field(5, tensor(1, kind=7, raw=struct.pack("<q", value), more=field(8, name)))
        for name, value in (("zero", 0), ("two", 2))
    ]
    check_onnx(model(MAP, *numbers, *(field(1, part) for part in nodes)))


def test_a_bomb_costs_no_memory(tmp_path: Path) -> None:
    """A kilobyte that both runtimes would run in 4 MB a pixel."""
    path = tmp_path / "bomb.onnx"
    path.write_bytes(model(MAP, *doubled(20, 1)))
    assert path.stat().st_size < 2000
    with pytest.raises(DenoiserError, match="makes 16384 numbers a pixel"):
        load_onnx(path)


def test_a_sparse_file_is_refused_at_once(tmp_path: Path) -> None:
    """Every two bytes of it were a field, for two minutes."""
    with (tmp_path / "holes.onnx").open("wb") as file:
        file.truncate(1 << 28)
    start = time.process_time()
    with pytest.raises(DenoiserError, match="is damaged"):
        load_onnx(tmp_path / "holes.onnx")
    assert time.process_time() - start < 5


@pytest.mark.parametrize("damage", [lambda d, n: d[:n], lambda d, n: d[:n] + b"\xff" + d[n + 1 :]])
def test_damage_ends_in_a_reason_or_in_another_network(
    damage: Callable[[bytes, int], bytes],
) -> None:
    rng = np.random.default_rng(0)
    reasons = set()
    for place in rng.integers(0, len(SOUND), 200):
        try:
            check_onnx(damage(SOUND, int(place)))
        except ValueError as error:
            reasons.add(str(error))
    assert len(reasons) > 1
    assert "" not in reasons
