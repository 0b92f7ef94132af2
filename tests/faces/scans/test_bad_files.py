"""Test that whatever one file does, the other frames of a run are made."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from glsim.core.errors import GlsimError
from glsim.faces import open_source
from glsim.faces.face_source import BadFace, Face, FaceKey, FaceSource
from glsim.faces.meshes import load
from glsim.faces.meshes.load import read_mesh
from glsim.faces.sources.folder import Folder
from glsim.settings.schema import load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.pipeline import simulate
from tests.support.face_sets import FACE, TRIANGLES, obj_bytes, put

MESH = obj_bytes(FACE, TRIANGLES)


@pytest.mark.parametrize(
    "error",
    [MemoryError(), OSError(5, "Input/output error"), IndexError("of a library")],
    ids=lambda error: type(error).__name__,
)
@pytest.mark.parametrize("first", [True, False])
def test_any_exception_of_a_reader_costs_one_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, first: bool
) -> None:
    for number in range(4):
        put(tmp_path / "a" / f"{number}.obj", MESH)
    bad = tmp_path / "a" / ("0.obj" if first else "2.obj")

    def read(path: Path) -> Any:
        if path == bad:
            raise error
        return read_mesh(path)

    monkeypatch.setattr(load, "read_mesh", read)
    source = Folder(tmp_path)
    faces = list(source.load(source.frames("a", None)))
    assert [isinstance(face, Face) for face in faces] == [
        number != int(bad.stem) for number in range(4)
    ]
    (message,) = (str(face.error) for face in faces if isinstance(face, BadFace))
    assert message.startswith(f"{bad}: cannot be used ({type(error).__name__}")


class Files(FaceSource):
    """A source of the user's whose reader is not prepared for what is in a file."""

    name = "mine"

    def subjects(self, count: int | None) -> list[str]:
        return ["a"]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [FaceKey("a", "main", number, 0.0, f"{number}.bin") for number in range(5)]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        heads = open_source(load_settings().source[0], 0)
        mesh = next(iter(heads.load(heads.frames("p0000", 1))))
        for key in keys:
            if key.frame in (1, 2):
                raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")
            yield Face(key, mesh.mesh)


def test_a_source_that_dies_at_a_file_goes_on_with_the_next(tmp_path: Path) -> None:
    settings = load_settings(overrides={"sensor": "ideal", "output": {"crop": 64}})
    frames = list(simulate(settings, sources=[Files()]))
    assert [type(frame) for frame in frames] == [Frame, Skipped, Skipped, Frame, Frame]
    assert isinstance(frames[1], Skipped)
    assert frames[1].why.startswith("1.bin: cannot be used (UnicodeDecodeError: 'utf-8' codec")


def test_a_source_that_forgets_a_frame_is_told(tmp_path: Path) -> None:
    class Forgetful(Files):
        def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
            return iter(())

    settings = load_settings(overrides={"sensor": "ideal"})
    with pytest.raises(GlsimError, match="source mine gave no face for"):
        list(simulate(settings, sources=[Forgetful()]))
