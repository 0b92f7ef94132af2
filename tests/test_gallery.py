"""Every script of the gallery runs in an empty folder and draws a picture with something on it."""

from __future__ import annotations

import runpy
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.support.imports import ROOT


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(p, id=p.name, marks=[] if p.name == "05_own_stage.py" else pytest.mark.long)
        for p in sorted((ROOT / "docs" / "gallery").glob("*.py"))
    ],
)
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
            (number,) = pyplot.get_fignums()
            pyplot.figure(number).savefig(tmp_path / "picture.png")
        for axis in pyplot.figure(number).axes:
            assert axis.has_data()
            for image in axis.get_images() if "ideal" not in axis.get_title() else ():
                assert np.nanstd(np.asarray(image.get_array(), float)) > 0
        assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    finally:
        pyplot.close("all")
