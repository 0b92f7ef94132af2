"""Recipes: inheritance, errors, and the network and loss of each shipped one."""

from pathlib import Path

import pytest
import torch

from glsim.core.errors import ConfigError
from glsim.train.losses import build_loss
from glsim.train.models.registry import build_model
from glsim.train.recipe import ScheduleSettings, load_recipe, recipe_names

ROWS = {"D7", "AR D7", "D20", "AR D20", "D64", "AR D64", "UNet", "Restormer"}


@pytest.mark.parametrize("name", recipe_names())
def test_a_shipped_recipe_builds_its_network_and_its_loss(name: str) -> None:
    recipe = load_recipe(name)
    with torch.device("meta"):
        assert sum(p.numel() for p in build_model(recipe.model).parameters()) > 1000
    build_loss(recipe.loss)
    if recipe.size == "small" and recipe.row is not None:
        assert "instead of" in recipe.description
        assert recipe.training.max_steps


@pytest.mark.parametrize("size", ["full", "small"])
def test_every_row_of_the_paper_has_a_recipe_with_its_settings(size: str) -> None:
    recipes = [load_recipe(name) for name in recipe_names() if name.startswith("paper-")]
    of_size = [recipe for recipe in recipes if recipe.size == size]
    assert {recipe.row for recipe in of_size} == ROWS
    assert len(of_size) == len(ROWS)
    for recipe in of_size:
        assert (recipe.optimiser.kind, recipe.optimiser.lr) == ("adam", 1e-4)
        assert (recipe.training.batch, recipe.training.patience) == (4, 10)
        assert recipe.loss == {"kind": "all_pixels"}
        assert recipe.training.precision == "32-true"


def test_a_recipe_of_ones_own_holds_only_differences(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text('extends = "face"\n[training]\nbatch = 3\n')
    own = tmp_path / "own.toml"
    own.write_text(
        'extends = "base.toml"\ntitle = "mine"\n[model.backbone]\nkind = "dncnn"\ndepth = 3\n'
        '[loss]\nkind = "all_pixels"\n'
    )
    recipe = load_recipe(str(own), ["model.backbone.width=5", "optimiser.lr=1e-5"], {"seed": 4})
    face = load_recipe("face")
    assert recipe.model["backbone"] == {"kind": "dncnn", "depth": 3, "width": 5}
    assert recipe.loss == {"kind": "all_pixels"}, "another kind takes nothing over"
    assert (recipe.training.batch, recipe.seed, recipe.optimiser.lr) == (3, 4, 1e-5)
    assert recipe.training.ema_decay == face.training.ema_decay


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('extends = "fase"', "did you mean 'face'"),
        ('extends = "own.toml"', "circle"),
        ("extends = 3", "extends must be the name"),
        ('extends = "face"\n[training]\npatiense = 2', "patiense.*did you mean 'training.patience"),
        ('extends = "face"\n[training]\nmonitor = "psnr"', "training.monitor.*interior_rmse_mm"),
        ('extends = "face', "own.toml"),
        ('title = "x"', "model: is missing"),
    ],
)
def test_bad_recipes_are_refused_with_what_to_do(tmp_path: Path, text: str, problem: str) -> None:
    own = tmp_path / "own.toml"
    own.write_text(text)
    with pytest.raises(ConfigError, match=problem):
        load_recipe(str(own))


def test_unknown_names_are_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean 'paper-d7'"):
        load_recipe("paper-d-7")
    with pytest.raises(ConfigError, match=r"none\.toml: no such file"):
        load_recipe("none.toml")
    with pytest.raises(ConfigError, match="write name=value"):
        load_recipe("face", ["training.batch"])
    with pytest.raises(ConfigError, match=r"no such kind 'maskd' .*did you mean 'masked'"):
        build_loss({"kind": "maskd"})
    with pytest.raises(ConfigError, match=r"beta_m.*did you mean 'beta_mm'"):
        build_loss({"kind": "masked", "beta_m": 2})


def test_what_may_differ_when_a_training_goes_on() -> None:
    face = load_recipe("face")
    assert face.difference(load_recipe("face", ["training.max_epochs=2"])) is None
    assert face.difference(load_recipe("face", ["loss.beta_mm=2"])) == "loss.beta_mm is None, not 2"


def test_the_learning_rate() -> None:
    cosine = ScheduleSettings(kind="cosine", warmup_steps=9, final=0.1)
    assert cosine.factor(0, 0.0) == pytest.approx(0.1)
    assert cosine.factor(9, 0.0) == 1
    assert cosine.factor(0, 0.05) == pytest.approx(0.5, rel=0.02), "short: warm after a tenth"
    assert cosine.factor(100, 0.5) == pytest.approx(0.55)
    assert cosine.factor(100, 1.0) == pytest.approx(0.1)
