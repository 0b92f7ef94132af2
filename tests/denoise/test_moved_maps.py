"""``glsim denoise`` on maps that are moved to 1 mm, and networks that were trained on such."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.depth_protocol import offset_to_nearest
from glsim.core.errors import ConfigError
from glsim.core.units import subtract_offset
from glsim.denoise.registry import load_denoiser
from tests.support.eval_scenes import dome
from tests.support.moved_sets import write_both_protocols


class Trained:
    """Stands for a network that was trained under the protocol paper: it shrinks all depth."""

    protocol = "paper"

    def __call__(self, noisy_mm: Any, valid: Any) -> tuple[Any, Any]:
        return 0.6 * noisy_mm, valid


WHOLE_MM = ("--out-unit-mm", "1", "-q")
NETWORK = "net@tests.denoise.test_moved_maps:Trained"


def read(path: Path) -> Any:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32)


def written(folder: Path) -> dict[str, Any]:
    return {str(file.relative_to(folder)): read(file) for file in sorted(folder.rglob("*.png"))}


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_both_protocols(tmp_path_factory.mktemp("sets"))


@pytest.mark.parametrize("denoiser", ["median", "bilateral", "temporal_median"])
def test_an_offset_of_the_input_changes_nothing_but_the_offset(
    sets: dict[str, Path], tmp_path: Path, denoiser: str
) -> None:
    """Files keep the offset of their input: clean maps of the same set stay comparable."""
    results = {}
    for name, data in sets.items():
        folder = data / "test" / "s001"
        command = ["denoise", str(folder), "-o", str(tmp_path / name), "-d", denoiser, *WHOLE_MM]
        assert main(command) == 0
        results[name] = written(tmp_path / name)
    assert results["depth"].keys() == results["paper"].keys()
    assert len(results["depth"]) == 2
    # Frames 2 and 3 of the set: the dome's tip is at 920 and 930 mm.
    for (name, measured), offset_mm in zip(results["depth"].items(), (919, 929), strict=True):
        wanted = subtract_offset(measured, offset_mm)
        # A median of two depths may be half a millimetre, which rounds to even.
        atol = 1 if denoiser == "temporal_median" else 0
        np.testing.assert_allclose(results["paper"][name], wanted, atol=atol, rtol=0)


def test_the_protocol_paper_moves_maps_and_moves_them_back(
    sets: dict[str, Path], tmp_path: Path
) -> None:
    """NLM depends on the distance: a hole is a depth of 0."""
    noisy = sets["depth"] / "test" / "s001"
    command = ["denoise", str(noisy), "-d", "nlm", *WHOLE_MM]
    assert main([*command, "-o", str(tmp_path / "depth")]) == 0
    assert main([*command, "-o", str(tmp_path / "paper"), "--protocol", "paper"]) == 0
    at_1_mm, as_measured = written(tmp_path / "paper"), written(tmp_path / "depth")
    nlm = load_denoiser("nlm")
    for name, result in at_1_mm.items():
        given = read(noisy / name)
        offset_mm = offset_to_nearest(given)
        moved = nlm(subtract_offset(given, offset_mm)).depth_mm
        np.testing.assert_array_equal(result, np.where(moved > 0, moved + offset_mm, 0))
        assert (result != as_measured[name]).any()


def test_a_network_gets_the_protocol_of_its_training(
    sets: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Maps of a set at 1 mm are given as they are stored."""
    noisy = sets["paper"] / "test" / "s001"
    command = ["denoise", str(noisy), "-d", NETWORK, "-o", str(tmp_path / "o")]
    assert main([*command, *WHOLE_MM]) == 0
    for name, result in written(tmp_path / "o").items():
        given = read(noisy / name)
        np.testing.assert_array_equal(
            result, np.where(given > 0, np.maximum(np.rint(0.6 * given), 1), 0)
        )
    assert main([*command, "--protocol", "depth"]) == 2
    assert "net: was trained under the protocol paper" in capsys.readouterr().err


def test_maps_in_memory_must_fit_the_training() -> None:
    denoise = load_denoiser(NETWORK)
    clean = dome()
    moved = subtract_offset(clean, 899)
    np.testing.assert_allclose(denoise(moved).depth_mm, 0.6 * moved)
    with pytest.raises(ConfigError, match=r"this map's is at 900 mm: subtract"):
        denoise(clean.astype(np.uint16))


def test_plain_maps_at_1_mm_need_the_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = np.where(dome() > 0, dome() - 899, 0).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), moved)
    command = ["denoise", str(tmp_path / "a.png"), "-o", str(tmp_path / "b.png"), "-d", "median"]
    assert main(command) == 1
    assert "moved to 1 mm (--protocol paper)?" in capsys.readouterr().err
    assert main([*command, "--protocol", "paper", "--out-unit-mm", "1", "-q"]) == 0
    wanted = load_denoiser("median")(moved.astype(np.float32)).depth_mm
    np.testing.assert_array_equal(read(tmp_path / "b.png"), wanted)
    cv2.imwrite(str(tmp_path / "a.png"), (moved > 0).astype(np.uint16))  # whole metres
    assert main([*command, "--protocol", "paper"]) == 1
    assert "metres instead of millimetres" in capsys.readouterr().err
