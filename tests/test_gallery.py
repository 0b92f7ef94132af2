"""Every script of the gallery runs in an empty folder and draws a picture with something on it."""

from __future__ import annotations

import runpy
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.imports import ROOT

GALLERY = sorted((ROOT / "docs" / "gallery").glob("*.py"))
#: Runs in a second; the others are long.
QUICK = "05_own_stage.py"


def _marked(script: Path) -> Any:
    return pytest.param(script, id=script.name, marks=[] if script.name == QUICK else LONG)


LONG = [pytest.mark.long]


@pytest.mark.parametrize("script", [_marked(script) for script in GALLERY])
def test_a_script_of_the_gallery_draws_its_picture(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    matplotlib = pytest.importorskip("matplotlib", reason="the extra glsim[eval] is not installed")
    matplotlib.use("agg")
    from matplotlib import pyplot

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pyplot, "show", lambda: None)
    pyplot.close("all")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            runpy.run_path(str(script))
            figures = [pyplot.figure(number) for number in pyplot.get_fignums()]
            assert len(figures) == 1
            figures[0].savefig(tmp_path / "picture.png")
        axes = [axis for axis in figures[0].axes if axis.get_label() != "<colorbar>"]
        assert all(_shows_something(axis) for axis in axes if axis.has_data())
        assert sum(axis.has_data() for axis in axes) == len(axes)
        assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    finally:
        pyplot.close("all")


def _shows_something(axis: Any) -> bool:
    """Whether an axis has an image of several values, points or a curve; the ideal sensor has 0."""
    if "ideal" in axis.get_title():
        return True
    images = [np.asarray(image.get_array()) for image in axis.get_images()]
    if images:
        finite = np.concatenate([image[np.isfinite(image)].ravel() for image in images])
        return finite.size > 500 and float(finite.std()) > 0
    clouds = [np.ma.getdata(points.get_offsets()) for points in axis.collections]
    curves = [np.asarray(line.get_ydata(), float) for line in axis.lines]
    return any(len(points) > 500 for points in clouds) or any(np.ptp(c) > 0 for c in curves)


def test_every_family_of_sensors_is_in_the_gallery() -> None:
    """The sensors whose files extend no other: a mode of a camera needs no picture of its own."""
    from glsim import sensor_names
    from glsim.sensors.sensor import sensor_file
    from glsim.settings.tables import read_toml

    text = "".join(script.read_text(encoding="utf-8") for script in GALLERY)
    families = [name for name in sensor_names() if "extends" not in read_toml(sensor_file(name))]
    assert [name for name in families if f'"{name}"' not in text] == []


def test_scripts_begin_with_their_number_and_a_title() -> None:
    numbers = [int(script.name.partition("_")[0]) for script in GALLERY]
    assert numbers == list(range(1, len(GALLERY) + 1))
    for script in GALLERY:
        first, title, line, *_ = script.read_text(encoding="utf-8").splitlines()
        assert (first, line) == ('"""', "=" * len(title)), script.name
