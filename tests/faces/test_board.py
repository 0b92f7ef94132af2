"""The board: flat, facing the camera, at the distance that the pose states."""

from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import ConfigError
from glsim.faces import open_source
from glsim.faces.sources.board import Board
from glsim.settings.source_settings import parse_source
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from tests.support.scenes import only_frame, settings_for


def frame_of(context: Context, pose: dict[str, Any]) -> Frame:
    source = {"kind": "board", "subjects": 1, "frames_per_subject": 1}
    settings = settings_for(pose=pose, output={"crop": 200}, source=source)
    return only_frame(simulate(settings, context=context))


def test_it_is_flat_and_of_its_size_at_its_distance(context: Context) -> None:
    frame = frame_of(context, {"distance_mm": 900})
    seen = frame.clean > 0
    assert set(np.unique(frame.clean[seen])) <= {899, 900, 901}
    fx, fy = frame.intrinsics.fx, frame.intrinsics.fy
    assert seen.any(axis=0).sum() == pytest.approx(160 * fx / 900, abs=2)
    assert seen.any(axis=1).sum() == pytest.approx(220 * fy / 900, abs=2)
    turned = frame_of(context, {"distance_mm": 900, "yaw_deg": 30})
    row = turned.clean[100][turned.clean[100] > 0].astype(float)
    assert np.ptp(row) == pytest.approx(160 * np.sin(np.radians(30)), abs=4)


def test_boards_are_endless_and_depend_on_their_keys(context: Context) -> None:
    source = open_source(parse_source({"kind": "board", "width_mm": 300}), seed=1)
    assert isinstance(source, Board)
    assert source.subjects(2) == ["b0000", "b0001"]
    keys = source.frames("b0001", 3)
    assert [(key.subject, key.frame) for key in keys] == [("b0001", n) for n in range(3)]
    (face,) = source.load(keys[2:])
    assert np.ptp(face.mesh.vertices_mm, axis=0).tolist() == [300.0, 220.0, 0.0]  # type: ignore[union-attr]
    for endless in (lambda: source.subjects(None), lambda: source.frames("b0000", None)):
        with pytest.raises(ConfigError, match="never end"):
            endless()
    with pytest.raises(ValueError, match="width_mm"):
        parse_source({"kind": "board", "width_mm": 0})
