"""The plan of the house: which room of glsim may import from which, and no circles."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from glsim.core.files.png import encode_png
from tests.support.imports import ROOT, all_modules, imported_modules, loaded_after, third_party

#: Rooms from the ground floor up. A module imports from its own room and from earlier ones; a
#: longer name wins, so that glsim.train.models is a room of its own below glsim.denoise.
ROOMS = (
    "glsim.core",
    "glsim.measures",
    "glsim.networks",
    "glsim.settings",
    "glsim.shaders",
    "glsim.gl",
    "glsim.render",
    "glsim.noise",
    "glsim.sensors",
    "glsim.faces",
    "glsim.looks",
    "glsim.simulation",
    "glsim.integrations",
    "glsim.data",
    "glsim.train.models",
    "glsim.denoise",
    "glsim.bench",
    "glsim.train",
    "glsim.eval.metrics",
    "glsim.eval.scoring",
    "glsim.eval.real_frames",
    "glsim.eval.report",
    "glsim.eval.paper",
    "glsim.eval",
    "glsim",  # the public names
    "glsim.cli",
    "glsim.__main__",
)

#: Rooms that do not know each other, though one of them comes first; the paper stands above both.
STRANGERS = ("glsim.train", "glsim.eval")
ABOVE_BOTH = "glsim.eval.paper"

#: Packages that are heavy or have one place: package -> the rooms that may import it.
HOMES = {
    "moderngl": (
        "glsim.gl",
        "glsim.render",
        "glsim.noise.chain",
        "glsim.noise.stage_pass",
        "glsim.simulation.render_cache",
        "glsim.simulation.pipeline",
        "glsim.simulation.virtual_camera",
        "glsim.cli.tune_page.preview",
        "glsim.cli",
    ),
    "gymnasium": ("glsim.integrations",),
    "trimesh": ("glsim.faces.meshes",),
    "mapbox_earcut": ("glsim.faces.meshes.obj",),
    "DracoPy": ("glsim.faces.meshes.gltf",),
    "typer": ("glsim.cli",),
    "rich": ("glsim.cli",),
    "torch": (
        "glsim.train",
        "glsim.denoise.inference",
        "glsim.networks.checkpoint",
        "glsim.simulation.tensor_engine",
    ),
    "safetensors": ("glsim.networks.checkpoint",),
    "lightning_fabric": ("glsim.train",),
    "tensorboard": ("glsim.train",),
    "matplotlib": ("glsim.eval.report.figures", "glsim.eval.paper.figures", "glsim.bench.figures"),
    "jinja2": ("glsim.eval.report.document",),
    "nicegui": ("glsim.cli.tune_page",),
    "fastapi": ("glsim.cli.tune_page.page",),
    "tomlkit": ("glsim.cli.tune_page",),
    "playwright": (),
    "skimage": (),
    "sklearn": ("glsim.bench.compare.classifier",),
    "scipy": ("glsim.bench.compare.replay_surfaces",),
    "huggingface_hub": (),
    "rosbags": ("glsim.data.recordings.bag",),
    "av": ("glsim.data.recordings.mkv",),
    "OpenEXR": ("glsim.core.files.exr",),
    "bm3d": ("glsim.denoise.filters.block_matching",),
    "fsspec": ("glsim.core.files.cloud",),
    "ray": ("glsim.data.ray_cluster", "glsim.data.ray_renderer"),
    "s3fs": (),
    "moto": (),
    "datasets": (),
    "pyrender": (),
    "open3d": (),
    "pytest": (),
    "hypothesis": (),
    "tests": (),
    "tools": (),
    "train": (),
    "eval": (),
}

#: Most modules of glsim that reading a folder of PNG maps loads.
MOST_LOADED = 70

MODULES = all_modules()


def within(module: str, room: str) -> bool:
    """Whether a module is a room or lies in it."""
    return module == room or module.startswith(f"{room}.")


def room_of(module: str) -> str:
    """The room with the longest name that holds the module."""
    rooms = [room for room in ROOMS if within(module, room)]
    return max(rooms, key=len)


def broken_rules(module: str, source: str) -> list[str]:
    """What a source file imports that its place in the house does not allow."""
    try:
        imported = imported_modules(source, set(MODULES))
    except ValueError as error:
        return [str(error)]
    own = room_of(module)
    broken = []
    for name in sorted(imported - {module}):
        other = room_of(name)
        apart = (
            any(within(module, s) for s in STRANGERS)
            and any(within(name, s) and not within(module, s) for s in STRANGERS)
            and not within(module, ABOVE_BOTH)
        )
        if ROOMS.index(other) > ROOMS.index(own) or apart:
            broken.append(f"{own} does not import from {other}: {name}")
    for package in sorted(third_party(source) & set(HOMES)):
        if not any(within(module, home) for home in HOMES[package]):
            broken.append(f"{package} is not imported in {own}")
    return broken


@pytest.mark.parametrize("module", sorted(MODULES))
def test_imports_name_earlier_rooms(module: str) -> None:
    assert broken_rules(module, MODULES[module].read_text(encoding="utf-8")) == []


def test_every_room_exists_and_every_module_has_one() -> None:
    for room in ROOMS:
        assert any(within(module, room) for module in MODULES), room
    listed = [module for module in MODULES if room_of(module) == "glsim"]
    assert listed == ["glsim"], "a new room: write it into ROOMS where it belongs"


@pytest.mark.parametrize(
    "source",
    [
        "def f():\n    from glsim import dataset",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from glsim.cli import app",
        "from importlib import import_module\nimport_module('glsim.eval.scoring.evaluate')",
        "from ..pipeline import simulate",
        "import torch",
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, source: str) -> None:
    """A file in glsim/noise that breaks the rule in each of the ways there are."""
    file = tmp_path / "temporary.py"
    file.write_text(f'"""Mentions glsim.cli, which a docstring may."""\n\n{source}\n')
    assert len(broken_rules("glsim.noise.temporary", file.read_text())) == 1
    allowed = '"""Draws."""\n\nfrom glsim.render.renderer import Renderer\nimport numpy\n'
    assert broken_rules("glsim.noise.temporary", allowed) == []


def test_no_module_imports_itself_through_others() -> None:
    """Circles, also those that exist for types or inside functions only."""
    graph = {
        module: imported_modules(file.read_text(encoding="utf-8"), set(MODULES)) - {module}
        for module, file in MODULES.items()
    }
    done: set[str] = set()

    def visit(module: str, way: tuple[str, ...]) -> None:
        assert module not in way, " -> ".join((*way[way.index(module) :], module))
        if module not in done:
            for other in sorted(graph[module]):
                visit(other, (*way, module))
            done.add(module)

    for module in sorted(graph):
        visit(module, ())


def test_a_folder_of_png_maps_is_read_by_few_modules(tmp_path: Path) -> None:
    """No sensor, noise stage or face is loaded before a file names one."""
    for number in range(2):
        image = encode_png(np.full((48, 64), 900 + number, np.uint16))
        (tmp_path / f"{number}.png").write_bytes(image)
    code = f"from glsim.data.maps import open_maps; open_maps({str(tmp_path)!r}).frames[1].noisy_mm"
    loaded = {name for name in loaded_after(code) if within(name, "glsim")}
    assert len(loaded) <= MOST_LOADED, sorted(loaded)
    rooms = {room_of(name) for name in loaded}
    assert rooms.isdisjoint({"glsim.gl", "glsim.noise", "glsim.sensors", "glsim.faces"})


@pytest.mark.parametrize(
    ("code", "not_loaded"),
    [
        ("import glsim", {"torch", "cv2", "moderngl", "trimesh", "typer", "rich", "numpy"}),
        ("import glsim; glsim.load_settings()", {"torch", "cv2", "trimesh"}),
        ("import glsim, glsim.data", {"cv2", "moderngl"}),
        ("import glsim.cli; glsim.cli.main(['--help'])", {"torch", "cv2", "moderngl", "numpy"}),
        ("import glsim.cli, glsim.train.recipe", {"torch", "cv2", "moderngl", "matplotlib"}),
        ("import glsim.eval.scoring.evaluate", {"torch", "matplotlib"}),
        ("import glsim.train, glsim.train.data", {"torch", "lightning_fabric", "cv2", "numpy"}),
        ("from glsim.train import load_recipe, recipe_names", {"torch"}),
    ],
)
def test_nothing_heavy_is_loaded_early(code: str, not_loaded: set[str]) -> None:
    assert not loaded_after(code) & not_loaded


def test_the_folders_at_the_top_are_packages_of_glsim() -> None:
    for name in ("eval", "shaders", "train"):
        assert Path(import_module(f"glsim.{name}").__path__[0]).resolve() == ROOT / name
