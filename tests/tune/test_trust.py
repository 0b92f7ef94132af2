"""What a link may name."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import pytest

from glsim.errors import ConfigError
from glsim.settings.schema import load_settings
from glsim.tune.state import Tuning, tuning_of_link
from glsim.tune.trust import check_link, code_of


def packed(tree: Any) -> str:
    return base64.urlsafe_b64encode(zlib.compress(json.dumps(tree).encode())).decode().rstrip("=")


def test_files_in_the_folder_and_shipped_sensors_may_be_named(tmp_path: Path) -> None:
    for sensor in ("kinect-v2", "mine.toml", "a/b.toml", str(tmp_path / "x.toml"), "/own/s.toml"):
        check_link(Tuning(sensor, {"rig.focal_px": [9, 9]}), "/own/s.toml", tmp_path)
    check_link(Tuning("ideal", {"rig.fixed_pattern_map": "map.npy"}), "ideal", tmp_path)
    check_link(Tuning("ideal", {"rig.projector_image": "dots.png"}), "ideal", tmp_path)


@pytest.mark.parametrize("sensor", ["/etc/evil.toml", "../x.toml", "a/../../x.toml", "~/x.toml/.."])
def test_files_elsewhere_may_not(tmp_path: Path, sensor: str) -> None:
    inside = sensor.startswith("~")  # a folder called ~ here
    named = [{"rig.fixed_pattern_map": sensor}, {"rig.projector_image": sensor}]
    for tuning in (Tuning(sensor), *(Tuning("ideal", values) for values in named)):
        if inside:
            check_link(tuning, "ideal", tmp_path)
            continue
        with pytest.raises(ConfigError, match="outside of"):
            check_link(tuning, "ideal", tmp_path)


def test_a_link_in_the_folder_to_elsewhere_is_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "out.toml").symlink_to("/etc/passwd")
    with pytest.raises(ConfigError, match="outside of"):
        check_link(Tuning("out.toml"), "ideal", tmp_path)


@pytest.mark.parametrize("name", ["source.root", "source", "rig", "output.format", "sensor"])
def test_a_link_sets_noise_alone(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="which the page does not change"):
        check_link(Tuning("ideal", {name: "x"}), "ideal", tmp_path)


def test_code_is_named_and_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "evil.py").write_text("open('ran', 'w')")
    (tmp_path / "s.toml").write_text('title = "s"\n[[stage]]\nuse = "evil.py:stage"\n')
    base = load_settings()
    assert code_of(Tuning("s.toml"), base, "ideal") == ["evil.py:stage"]
    assert code_of(Tuning("s.toml"), base, "s.toml") == []
    assert code_of(Tuning("kinect-v2"), base, "ideal") == []
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("nested", [30, 900, 200_000])
def test_a_link_that_is_nested_deeply_is_refused(nested: int) -> None:
    deep = "[" * nested + "]" * nested
    text = f'{{"sensor":"ideal","values":{{"a":{deep}}},"code":{{}},"frame":0}}'
    link = base64.urlsafe_b64encode(zlib.compress(text.encode())).decode()
    with pytest.raises(ConfigError, match="holds no settings of glsim tune"):
        tuning_of_link(link)


@pytest.mark.parametrize(
    "name", ['x" innerHTML="<img src=x onerror=alert(1)>', "", "a b", "a/b", "é", "x" * 65, "a.b"]
)
def test_names_of_stages_hold_no_script(name: str, tmp_path: Path) -> None:
    from glsim.sensors.sensor import load_sensor

    (tmp_path / "s.toml").write_text(
        'title = "s"\n[rig]\nwidth = 16\nheight = 16\nfocal_px = [9, 9]\ncentre_px = [8, 8]\n'
        f'[[stage]]\nuse = "axial"\nname = {json.dumps(name)}\n'
    )
    with pytest.raises(ConfigError, match=r"s\.toml: stage 1: .* is no name of a stage: take lett"):
        load_sensor(str(tmp_path / "s.toml"))


def test_a_packed_tree_of_other_keys_is_refused() -> None:
    endless = {"sensor": "ideal", "values": {}, "code": {}, "frame": float("inf")}
    with pytest.raises(ConfigError, match="holds no settings of glsim tune"):
        tuning_of_link(packed(endless))
    with pytest.raises(ConfigError, match="other keys"):
        tuning_of_link(packed({"sensor": "ideal"}))
