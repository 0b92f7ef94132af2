"""Test that a folder of glsim's own is read as what it is."""

from collections import Counter
from pathlib import Path

import pytest

from glsim.core.errors import NoDepthError
from glsim.data.recordings.folders import list_maps


def touch(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


NAMES = ("clean", "expected", "noisy", "infrared", "reason", "regions")
LAYERS = [f"test/p1/s_{layer}.png" for layer in NAMES]


def test_layers_of_frames_are_told_apart(tmp_path: Path) -> None:
    touch(tmp_path, *LAYERS, "contact_sheet.png", "face_preview.png", "my_map.png", "frame1.png")
    for kind in ("clean", "noisy"):
        files, others = list_maps(tmp_path, kind)  # type: ignore[arg-type]
        own = [tmp_path / "frame1.png", tmp_path / "my_map.png"]
        assert files == [*own, tmp_path / f"test/p1/s_{kind}.png"]
        left = {f"*_{layer}.png" for layer in (*NAMES, "preview") if layer != kind}
        assert others == Counter(left | {"contact_sheet.png"})


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a_clean.png", "b_clean.png"], r"no noisy depth maps, only 2 \*_clean.png: to take"),
        (["train-000000.tar"], r"its frames are in shards \(train-000000.tar\)"),
        (["notes.txt"], "holds no depth maps"),
    ],
)
def test_nothing_to_read_is_explained(tmp_path: Path, names: list[str], message: str) -> None:
    touch(tmp_path, *names)
    with pytest.raises(NoDepthError, match=message):
        list_maps(tmp_path, "noisy")
