"""Preview pictures: shaded depth, differences, reasons and contact sheets, as uint8 BGR arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import DepthFrame
from glsim.core.reason import Reason
from glsim.core.units import to_metres, to_mm
from glsim.simulation.assembly import reconcile_reasons

Picture = NDArray[np.uint8]

#: Directions to the lights in camera axes (y down): the key light at the upper left behind the
#: camera, the fill light at the right, and a weak light below, for the ceilings of rooms.
_KEY_LIGHT = np.array([-0.45, -0.55, -0.70]) / np.linalg.norm([-0.45, -0.55, -0.70])
_FILL_LIGHT = np.array([0.70, -0.10, -0.70]) / np.linalg.norm([0.70, -0.10, -0.70])
_LOW_LIGHT = np.array([0.0, 1.0, 0.0])

_BACKGROUND = (38, 32, 28)
_TEXT = (235, 235, 235)

#: Largest depth difference on the colour scale, mm; larger differences have the same colour.
DIFFERENCE_MM = 20.0

#: BGR colour per reason: greys and greens for pixels with depth, saturated colours for holes.
_REASON_COLOURS = {
    Reason.VALID: (150, 150, 150), Reason.NO_SURFACE: _BACKGROUND, Reason.SHADOW: (200, 60, 40),
    Reason.OUT_OF_RANGE: (180, 40, 160), Reason.LOW_SIGNAL: (30, 30, 200),
    Reason.EDGE: (30, 140, 240), Reason.DROPPED: (60, 60, 120), Reason.WINDOW: (40, 210, 240),
    Reason.MOVED: (120, 200, 60), Reason.GROWN: (200, 220, 90), Reason.SATURATED: (240, 240, 240),
    Reason.UNWRAP: (220, 120, 220), Reason.MIXED: (90, 120, 250),
}  # fmt: skip


def shaded(depth_m: NDArray[np.float32], intrinsics: Intrinsics) -> Picture:
    """Draw a depth map, (H, W) metres, as a matte surface under three lights: (H, W, 3) BGR."""
    normal = depth_map.normals(np.asarray(depth_m, dtype=np.float32), intrinsics.rays())
    key, fill, low = (np.clip(normal @ way, 0, 1) for way in (_KEY_LIGHT, _FILL_LIGHT, _LOW_LIGHT))
    grey = np.clip(20 + 195 * key + 55 * fill + 60 * low, 0, 255)[..., None]
    return np.where(depth_m[..., None] > 0, grey, _BACKGROUND).astype(np.uint8)


def difference(clean_m: NDArray[np.float32], noisy_m: NDArray[np.float32]) -> Picture:
    """Draw noisy minus clean depth in metres as colours (H, W, 3), blue nearer and red farther."""
    share = np.clip(to_mm(noisy_m - clean_m) / DIFFERENCE_MM, -1, 1)[..., None]
    white, near, far = (np.array(c, float) for c in ((245, 245, 245), (190, 80, 30), (40, 40, 190)))
    colour = white + np.where(share < 0, -share * (near - white), share * (far - white))
    colour[(clean_m <= 0) | (noisy_m <= 0)] = _BACKGROUND
    return np.asarray(colour, np.uint8)


def reasons(codes: NDArray[np.uint8]) -> Picture:
    """Draw reason codes (H, W) as colours (H, W, 3) BGR."""
    palette = np.array([_REASON_COLOURS[r] for r in sorted(Reason)], np.uint8)
    return np.asarray(palette[codes])


def frame_row(frame: DepthFrame, side: int) -> Picture:
    """Draw a row of cells of ``side`` pixels below the frame's name.

    Cells: shaded clean map, shaded noisy map, difference, reasons (inferred from depths if
    missing). Without a clean map: shaded noisy map, infrared.
    """
    noisy_m = frame.in_metres("noisy_mm")
    noisy = shaded(noisy_m, frame.intrinsics)
    if "clean_mm" in frame:
        clean_m = frame.in_metres("clean_mm")
        cells = [shaded(clean_m, frame.intrinsics), noisy, difference(clean_m, noisy_m)]
        cells.append(reasons(_codes(frame)))
        cells = [cell[_surface_slices(clean_m)] for cell in cells]
    else:
        cells = [noisy, brightness(frame.infrared, noisy_m.shape)]
    return _named(frame, np.hstack([_fit(cell, side) for cell in cells]))


def _named(frame: DepthFrame, picture: Picture) -> Picture:
    """Return the picture below a line with the frame's name."""
    line = np.full((_NAME_PX, picture.shape[1], 3), _BACKGROUND, np.uint8)
    _write(line, frame.name, (10, _NAME_PX - 6), 0.4)
    return np.vstack([line, picture])


def _codes(frame: DepthFrame) -> NDArray[np.uint8]:
    """Return the frame's reason codes, inferred from its depths if it has no such layer."""
    if "reason" in frame:
        return frame.reason
    maps = frame.clean_mm, frame.noisy_mm, np.zeros_like(frame.clean_mm)
    return reconcile_reasons(*maps).astype(np.uint8)


def brightness(infrared: NDArray[Any] | None, shape: tuple[int, ...]) -> Picture:
    """Draw infrared counts (None: empty) as grey, relative to their 99th percentile."""
    if infrared is None or not infrared.any():
        return np.full((*shape, 3), _BACKGROUND, np.uint8)
    share = infrared / np.percentile(infrared[infrared > 0], 99.0)
    grey = (255 * np.sqrt(np.clip(share, 0, 1))).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


#: Frames per column, largest number of columns (further frames make columns longer), and height of
#: the line with a frame's name above its cells, px.
_SHEET_ROWS, _SHEET_COLUMNS, _NAME_PX = 4, 3, 20
#: Side of a cell in a single column and in several columns, px: three columns fit a wide screen.
_WIDE_PX, _NARROW_PX = 300, 200
#: Columns of a gallery, and side of a cell, px.
_GALLERY_COLUMNS, _GALLERY_PX = 4, 240


def contact_sheet(frames: Sequence[DepthFrame], title: str) -> Picture:
    """Draw one ``frame_row`` per frame, with a title, headings, and a legend of the colours.

    Above four, frames are small, in up to three columns. All frames or none have clean maps.
    """
    columns = min(_SHEET_COLUMNS, -(-len(frames) // _SHEET_ROWS))
    side = _WIDE_PX if columns == 1 else _NARROW_PX
    headings: tuple[str, ...] = ("noisy, shaded", "infrared")
    with_clean = "clean_mm" in frames[0]
    if with_clean:
        headings = ("clean, shaded", "noisy, shaded", "noisy - clean", "invalid or altered")
    width = columns * len(headings) * side
    head = np.full((66, width, 3), _BACKGROUND, np.uint8)
    _write(head, title, (10, 26), 0.62)
    for column, text in enumerate(headings * columns):
        _write(head, text, (column * side + 10, 56), 0.5 if columns == 1 else 0.45)
    rows = _grid([frame_row(frame, side) for frame in frames], columns, down=True)
    if not with_clean:
        return np.vstack([head, rows])
    used = sorted({Reason(int(code)) for frame in frames for code in np.unique(_codes(frame))})
    texts = {code: f"{int(code)} {code.name.lower()}: {code.help}" for code in used}
    if Reason.DROPPED in texts and not all("reason" in frame for frame in frames):
        texts[Reason.DROPPED] = "lost, reason unknown: the data set has no layer reason"
    return np.vstack([head, rows, _legend(width, texts)])


def _grid(cells: list[Picture], columns: int, *, down: bool) -> Picture:
    """Arrange cells of equal size in ``columns``, column by column if ``down``, else row by row."""
    cells = cells + [np.full_like(cells[0], _BACKGROUND)] * (-len(cells) % columns)
    height = len(cells) // columns
    groups = [cells[n::height] if down else cells[n * columns :][:columns] for n in range(height)]
    return np.vstack([np.hstack(group) for group in groups])


def gallery(faces: Sequence[DepthFrame], title: str) -> Picture:
    """Draw shaded clean maps in a grid, each with its name."""
    columns = max(1, min(_GALLERY_COLUMNS, len(faces)))
    cells = []
    for face in faces:
        clean_m = face.in_metres("clean_mm")
        cell = shaded(clean_m, face.intrinsics)[_surface_slices(clean_m)]
        cells.append(_named(face, _fit(cell, _GALLERY_PX)))
    head = np.full((40, columns * _GALLERY_PX, 3), _BACKGROUND, np.uint8)
    _write(head, title, (10, 26), 0.5)
    return np.vstack([head, _grid(cells, columns, down=False)])


def _legend(width: int, texts: Mapping[Reason, str]) -> Picture:
    lines = 1 + len(texts)
    bar = np.full((24 * lines + 14, width, 3), _BACKGROUND, np.uint8)
    ramp = to_metres(np.linspace(-DIFFERENCE_MM, DIFFERENCE_MM, 240, dtype=np.float32)[None])
    bar[8:22, 10:250] = np.repeat(difference(np.ones_like(ramp), 1 + ramp), 14, axis=0)
    _write(bar, f"-{DIFFERENCE_MM:.0f} to +{DIFFERENCE_MM:.0f} mm", (260, 21), 0.45)
    for line, (code, text) in enumerate(texts.items(), start=1):
        y = 24 * line + 8
        bar[y : y + 14, 10:34] = _REASON_COLOURS[code]
        cv2.rectangle(bar, (10, y), (34, y + 14), (90, 90, 90), 1)
        _write(bar, text, (44, y + 12), 0.45)
    return bar


def _surface_slices(depth_m: NDArray[np.float32]) -> tuple[slice, ...]:
    """Return the rows and columns up to 6 px around pixels with depth; all without depth."""
    used = [np.flatnonzero(depth_m.any(axis=axis)) for axis in (1, 0)]
    return tuple(slice(max(0, n[0] - 6), n[-1] + 7) if len(n) else slice(None) for n in used)


def _fit(picture: Picture, side: int) -> Picture:
    """Scale a picture (nearest neighbour) and centre it in a square of ``side`` pixels."""
    scale = side / max(picture.shape[:2])
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    resized = cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST)
    cell = np.full((side, side, 3), _BACKGROUND, np.uint8)
    top, left = (side - size[1]) // 2, (side - size[0]) // 2
    cell[top : top + size[1], left : left + size[0]] = resized
    return cell


def _write(picture: Picture, text: str, at: tuple[int, int], size: float) -> None:
    """Draw text with its lower left corner at ``at``, (x, y) in pixels."""
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, _TEXT, 1, cv2.LINE_AA)
