"""Scores without any truth: planted noise, shifts, losses and boards come back."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.eval.real_frames.frame_truth import find_planes, rims_and_shadow
from glsim.eval.real_frames.halves import Source, split_recording
from glsim.eval.real_frames.score_recording import score_recording, tune_on_pairs
from glsim.eval.real_frames.totals import RealScores
from glsim.eval.report.figures.real_frames import measures_figure
from glsim.measures.boards import find_board, find_corners
from glsim.networks.composites import DEFAULT_COMPOSITE
from tests.support.planted_frames import frames_of, noisy, plane, shadowed
from tests.support.real_cameras import REAL_KINECT_V2, needs_real_kinect_v2
from tests.support.recordings import (
    BOARD_CENTRE,
    SQUARE_PX,
    board_infrared,
    printed,
    scene,
    write_frame,
    write_static_pair,
)

SIGMA_MM = 2.0
#: Denoisers of one test module; CLEAN is the scene without noise.
DENOISERS = """
import numpy as np
CLEAN = np.load({clean!r})
def truth(noisy, valid):
    return CLEAN.astype(np.float32), valid
def shifted(noisy, valid):
    return CLEAN.astype(np.float32) + 3, valid
def eroded(noisy, valid):
    kept = valid.copy(); kept[:, 299] = False
    return noisy, kept
def filled(noisy, valid):
    depth = np.where(valid, noisy, 800).astype(np.float32); kept = valid.copy()
    kept[50:350, 300:303] = True
    return depth, kept
def salted(noisy, valid):
    depth = np.where(valid, noisy, 1500).astype(np.float32); kept = valid.copy()
    kept[100, 303] = kept[200, 303] = True
    kept[50, 50] = kept[60, 60] = kept[70, 70] = False
    return depth, kept
def broken(noisy, valid):
    raise ValueError("out of film")
"""


@pytest.fixture
def pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording of a static pair, and the module ``planted_denoisers``."""
    clean = scene()
    np.save(tmp_path / "clean.npy", clean)
    text = DENOISERS.format(clean=str(tmp_path / "clean.npy"))
    (tmp_path / "planted_denoisers.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "planted_denoisers", raising=False)
    folder = tmp_path / "recording"
    folder.mkdir()
    write_static_pair(folder, clean, SIGMA_MM, drift_mm=1.5)
    return folder


def _scores(folder: Path, *names: str, **options: Any) -> RealScores:
    specs = [f"{n}@planted_denoisers:{n}" if ":" not in n else n for n in names]
    return score_recording(split_recording(Source(folder)), specs, workers=1, **options)


def test_static_pairs_give_the_error_without_the_truth(pair: Path) -> None:
    """Raw has the planted sigma though the second frame drifted; the truth has 0."""
    scores = _scores(pair, "truth", "shifted")
    assert (scores.static_frames, scores.scenes) == (2, 1)
    used = [k for k, pixels in enumerate(scores.pixels) if pixels > 10_000]
    assert used == [4, 7]
    for k in used:
        raw, truth, shifted = (m.pair_rmse_mm[k] for m in scores.methods.values())
        assert raw == pytest.approx(np.hypot(SIGMA_MM, 1 / np.sqrt(12)), rel=0.02)
        # CLEAN is exact for the first frame, and off by the drift of 1.5 mm for the second.
        assert truth == pytest.approx(1.5 / np.sqrt(2), abs=0.1)
        assert shifted == pytest.approx(np.sqrt((3.0**2 + 1.5**2) / 2), rel=0.03)
    change = scores.methods["shifted"].pair_change
    assert change.low < change.value < change.high


def test_a_shift_of_surfaces_is_found_at_every_distance(pair: Path) -> None:
    scores = _scores(pair, "shifted")
    # The second frame drifted by 1.5 mm, so that CLEAN + 3 is 3 and 1.5 mm away.
    for _, shift in scores.methods["shifted"].shift_by_100mm:
        assert shift == pytest.approx(2.25, abs=0.1)
    assert scores.methods["raw"].largest_shift_mm == 0.0


def test_what_moves_between_the_frames_does_not_count(pair: Path) -> None:
    clean = scene()
    clean[145:175, 370:400] += 25.0  # more than half of no block: still one view
    write_frame(pair, "0001", noisy(clean, SIGMA_MM, 2), board_infrared())
    scores = _scores(pair)
    assert scores.methods["raw"].pair_rmse_mm[7] == pytest.approx(SIGMA_MM, rel=0.04)
    # The wall has 206 columns of 424 rows; nothing of the moved part is left but its rim.
    assert scores.pixels[7] < 2 * (206 * 424 - 28 * 28)


def test_losses_and_fills_at_edges_are_counted(pair: Path) -> None:
    scores = _scores(pair, "eroded", "filled", "salted")
    edges = {name: m.edges for name, m in scores.methods.items()}
    assert edges["raw"]["ring_1_lost"] == edges["raw"]["shadow_filled"] == 0
    assert edges["eroded"]["ring_1_lost"] > 0.99
    assert edges["eroded"]["ring_2_lost"] == 0
    assert edges["filled"]["shadow_filled"] == pytest.approx(3 * 300 / (6 * 424), abs=0.02)
    assert edges["filled"]["alone_filled"] == 0
    assert edges["salted"]["alone_filled"] == 2
    assert edges["salted"]["pinholes"] == 3
    assert scores.own_ring_losses == (0, 0)


def test_the_ring_is_the_edge_of_the_nearer_surface_on_both_sides() -> None:
    frame = frames_of("panel", [shadowed(800.0, 2000.0, 3, 7)])[0]
    first, second, shadow = rims_and_shadow(frame)
    rows = slice(60, 360)
    assert set(np.flatnonzero(first[rows].any(axis=0))) == {180, 339}
    assert set(np.flatnonzero(second[rows].any(axis=0))) == {181, 338}
    assert set(np.flatnonzero(shadow[rows].any(axis=0))) == {*range(177, 180), *range(340, 347)}


def test_a_board_is_found_in_infrared_and_its_paper_has_the_planted_noise(tmp_path: Path) -> None:
    """Print is seen 6 mm farther, which is no noise: the paper's residual leaves it out."""
    infrared = board_infrared()
    depth = noisy(plane(800.0, 0.4, 0.1) + printed(infrared, 6.0), 1.2, 3)
    frame = frames_of("board", [depth], [infrared])[0]
    corners = find_corners(infrared.astype(np.float32))
    middle = corners.mean(axis=0)
    np.testing.assert_allclose(middle, [BOARD_CENTRE[1] - 0.5, BOARD_CENTRE[0] - 0.5], atol=0.3)
    assert np.ptp(corners[:, 0]) == pytest.approx(4 * SQUARE_PX, abs=0.5)
    board = find_board(frame, corners)
    assert (infrared[board.paper] > 2000).all()
    write_frame(tmp_path, "0000", depth, infrared)
    scores = _scores(tmp_path)
    assert scores.boards == 1
    assert scores.methods["raw"].paper_rmse_mm[4] == pytest.approx(1.23, rel=0.05)
    assert np.isnan(scores.methods["raw"].pair_rmse_mm).all()


@pytest.mark.long
def test_tuning_sees_one_half_and_scoring_the_other(pair: Path) -> None:
    recording = split_recording(Source(pair))
    tuned, trials = tune_on_pairs(recording, ["masked_gaussian"], workers=1)
    changes = {name: m.pair_change.value for name, m in trials.methods.items()}
    assert tuned == [min(changes, key=lambda name: changes[name])]
    # On planes with white noise the narrow windows of the grid lose clearly.
    assert tuned[0].startswith(("masked_gaussian:sigma_px=2", "masked_gaussian:sigma_px=3"))
    scored = _scores(pair, *tuned, scoring_half=True)
    whole = _scores(pair, *tuned)
    seen, held_out, both = (np.array(s.pixels) for s in (trials, scored, whole))
    np.testing.assert_array_equal(seen + held_out, both)
    assert min(seen[7], held_out[7]) > 0.4 * both[7]
    assert scored.methods[tuned[0]].pair_change.high < -70


@pytest.mark.long
def test_the_command_writes_the_same_tables_twice(pair: Path, tmp_path: Path) -> None:
    written = []
    for out in (tmp_path / "one", tmp_path / "two"):
        arguments = ["eval-real", str(pair), "-d", "guided:radius=2", "-o", str(out)]
        arguments += ["--workers", "1", "-q"]
        assert main(arguments) == 0
        names = ("table.md", "scores.json", "figures/measures.png")
        written.append([(out / name).read_bytes() for name in names])
    assert written[0] == written[1]
    scores = json.loads((tmp_path / "one" / "scores.json").read_text())
    assert set(scores["checksums"]) == {"0000_depth", "0001_depth"}
    assert scores["methods"]["guided:radius=2"]["pair_change"]["value"] < -40
    assert "guided:radius=2" in (tmp_path / "one" / "report.html").read_text()


@pytest.mark.long
def test_the_figure_shows_the_default_composite_of_a_network_alone(pair: Path) -> None:
    scores = score_recording(split_recording(Source(pair)), ["face", "guided:radius=2"], workers=1)
    assert "face [hard]" in scores.methods
    [legend] = measures_figure(scores).legends
    drawn = [text.get_text() for text in legend.get_texts()]
    assert drawn == ["raw", f"face [{DEFAULT_COMPOSITE}]", "guided:radius=2"]


def test_errors_name_the_place(
    pair: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    cases = [
        ([str(pair), "-d", "planted_denoisers:broken"], 1, "0000_depth: ValueError: out of film"),
        ([str(pair), "-d", "guided", "-d", "guided"], 2, "given twice"),
        ([str(pair), "--board", "five"], 2, "such as 5x7"),
        ([str(tmp_path / "nowhere")], 2, "no such file or folder"),
    ]
    for arguments, status, text in cases:
        assert main(["eval-real", *arguments, "-o", out, "--workers", "1", "-q"]) == status
        assert text in capsys.readouterr().err
    (pair / "0001_depth.png").unlink()
    assert main(["eval-real", str(pair), "--tune-filters", "-o", out, "-q"]) == 2
    assert "one static view" in capsys.readouterr().err


@needs_real_kinect_v2
def test_the_real_static_pair_has_the_noise_that_was_measured_twice(tmp_path: Path) -> None:
    """Against reality.md's row of 204 frames; their one pair here has other surfaces."""
    for name in ("0007", "0008"):
        for ending in ("_depth.png", "_ir.png", "_ir_points.yaml"):
            (tmp_path / f"{name}{ending}").symlink_to(REAL_KINECT_V2 / f"{name}{ending}")
    scores = score_recording(split_recording(Source(tmp_path)), ["guided"], workers=1)
    assert scores.boards == 2
    raw = np.array(scores.methods["raw"].pair_rmse_mm)
    np.testing.assert_allclose(raw[3:] / [1.83, 2.05, 3.36, 3.87, 2.03, 5.98], 1.0, atol=0.27)
    assert scores.methods["guided"].pair_change.high < 0


def test_planes_show_an_error_that_stays_and_pairs_do_not(tmp_path: Path) -> None:
    """A stereo camera's: the same bumps in each frame."""
    rng = np.random.default_rng(3)
    row, column = np.mgrid[:240, :320]
    wall = 1 / (1 / 1000 + 2e-7 * column + 1e-7 * row)
    bumps = cv2.GaussianBlur(rng.normal(size=wall.shape), (0, 0), 2) * 12
    for number in range(2):
        frame = wall + bumps + rng.normal(scale=1.0, size=wall.shape)
        frame[:100, :100] = 900 + 3e-3 * (row[:100, :100] - 50) ** 2 * 10  # it bends
        write_frame(tmp_path, f"{number:04d}", np.rint(frame).astype(np.uint16), wall)
    recording = split_recording(Source(tmp_path))
    tiles = find_planes(recording.frames[0].measured_mm)
    assert 12 <= len(tiles) <= 26
    assert all(part[0].start >= 96 or part[1].start >= 96 for part, _ in tiles)
    scores = score_recording(recording, ["guided"])
    raw, guided = (scores.methods[name] for name in ("raw", "guided"))
    planted_mm = float(np.hypot(bumps.std(), 1.04))
    assert raw.plane_rmse_mm[5] == pytest.approx(planted_mm, rel=0.1)
    assert guided.plane_change.value < 0
