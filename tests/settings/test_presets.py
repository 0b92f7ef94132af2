"""Presets: all load, their order among other settings, unknown names, and their line in --plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim.core.errors import ConfigError
from glsim.settings.presets import preset_names, preset_title
from glsim.settings.schema import load_settings


def test_the_shipped_presets_load_and_have_a_title() -> None:
    assert preset_names() == ["living-room", "office", "paper", "randomised", "sample"]
    for name in preset_names():
        load_settings(preset=name)
        assert 20 < len(preset_title(name)) < 90
    office = load_settings(preset="office")
    assert office.source[0].kind == "people"
    assert office.scene.room == "office"
    assert load_settings(preset="living-room").scene.room == "living-room"


def test_a_file_then_assignments_then_options_change_a_preset(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[scene]\nclutter = 0.1\ncamera_mm = 900\n[output]\ncrop = 64\n")
    settings = load_settings(
        file, ["scene.camera_mm=1100"], {"output": {"crop": 32}}, {"subjects": 7}, "office"
    )
    assert settings.scene.clutter.constant == 0.1
    assert settings.scene.camera_mm is not None
    assert settings.scene.camera_mm.constant == 1100
    assert settings.output.crop == 32
    assert (settings.source[0].kind, settings.source[0].subjects) == ("people", 7)
    assert settings.source[0].model_dump()["framing"] == "bust"


def test_another_source_or_a_wall_takes_the_place_of_the_presets() -> None:
    heads = load_settings(None, [], {}, {"kind": "procedural"}, "office")
    assert not hasattr(heads.source[0], "framing")
    assert heads.scene.room == "office"
    wall = load_settings(None, ["scene.wall_mm=4000"], {}, None, "office")
    assert wall.scene.room == "none"


def test_counts_hold_for_sources_of_every_kind(tmp_path: Path) -> None:
    """As a settings file's do; other keys of [source] mean nothing to another kind."""
    faces = {"kind": "ict-facekit", "root": str(tmp_path)}
    drawn = load_settings(None, [], {}, faces, "randomised").source[0]
    assert (drawn.kind, drawn.subjects, drawn.frames_per_subject) == ("ict-facekit", 20000, 90)
    fewer = load_settings(None, ["source.subjects=3"], {}, faces, "randomised")
    assert fewer.source[0].subjects == 3
    several = [{"kind": "procedural"}, {"kind": "people", "framing": "bust"}]
    both = load_settings(None, [], {"source": several}, None, "randomised")
    assert [source.subjects for source in both.source] == [10, 10]


def test_an_unknown_preset_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match=r"no such preset 'ofice' \(did you mean 'office'\?\)"):
        load_settings(preset="ofice")
