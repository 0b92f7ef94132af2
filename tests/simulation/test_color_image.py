"""Colour images: what they show, where they lie, and how they are kept."""

from pathlib import Path

import numpy as np
from moderngl import Context

import glsim
from glsim.cli import main
from glsim.faces.one_mesh import OneMesh
from glsim.settings.schema import Settings, with_assignments
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import frames, simulate
from tests.support.scenes import face_mesh, settings_for

HEADS = [{"kind": "procedural", "subjects": 2, "frames_per_subject": 2}]


def heads(context: Context, **values: object) -> list[Frame]:
    given = {"sensor": "ideal", "source": HEADS, "appearance.wear": "always", **values}
    settings = with_assignments(Settings(), given)
    return list(frames(settings, context=context, layers=("clean", "regions", "color")))


def test_regions_have_colours_that_belong_to_the_person(context: Context) -> None:
    made = heads(context)

    def hue(frame: Frame, region: str) -> np.ndarray:
        inside = frame.regions == frame.region_numbers[region]
        mean = frame.color[inside].mean(axis=0)
        return mean / mean.sum()

    for frame in made:
        assert frame.color.dtype == np.uint8
        assert frame.color.shape == (*frame.clean.shape, 3)
        assert not frame.color[frame.clean == 0].any()
        red, _, blue = hue(frame, "cheek")
        assert red > blue, "skin is reddish"
        assert 20 < frame.color[frame.clean > 0].mean() < 200, "exposed"
    for region in ("cheek", "cloth"):
        one, again, other, _ = (hue(frame, region) for frame in made)
        assert np.abs(one - again).max() < 0.2 * np.abs(one - other).max(), "of two people"
    same = heads(context)
    assert all((a.color == b.color).all() for a, b in zip(made, same, strict=True))


def test_a_mesh_without_regions_has_the_colour_of_skin(context: Context) -> None:
    made = simulate(
        settings_for(), sources=[OneMesh(face_mesh())], context=context, layers=("clean", "color")
    )
    frame = next(iter(made))
    image = frame.color[frame.clean > 0].astype(float)
    assert (image[:, 0] > image[:, 2]).mean() > 0.99
    assert image.std() > 10, "lit from one side"


def test_colour_is_written_and_read(tmp_path: Path) -> None:
    out = tmp_path / "data"
    words = ["generate", "-o", str(out), "--subjects", "1", "--frames-per-subject", "1"]
    layers = 'output.layers=["clean","noisy","color"]'
    given = ["--sensor", "realsense-d435", "--set", "rig.deliver=colour", "--set", layers]
    assert main([*words, *given, "--workers", "1", "--set", "output.crop=128"]) == 0
    assert main(["verify", str(out), "--deep"]) == 0
    (frame,) = glsim.open_dataset(out)
    image = frame["color"]
    assert (image.dtype, image.shape) == (np.uint8, (128, 128, 3))
    seen = frame["clean_mm"] > 0
    assert image[seen].mean() > 20
    assert not image[~seen].any()
    assert image[seen][:, 0].mean() > image[seen][:, 2].mean(), "red first"
