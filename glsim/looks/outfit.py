"""Sample the outfit of a subject from the settings and the subject's seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np

from glsim.core.seeds import rng_for
from glsim.looks.garments import LOWER, SHOES, UPPER, Garment
from glsim.looks.headwear import UNDER_BAND_MM, UNDER_HAT_MM, pressed
from glsim.looks.noise import Pattern
from glsim.looks.styles import STYLE_TABLE, STYLES, HairStyle
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import AppearanceSettings

_Choice = TypeVar("_Choice")

#: Entries (name of a hair colour, share of people, range of reflectivity).
HAIR_COLOURS: Final = STYLE_TABLE["hair_colours"]
BEARD_FROM_YEARS: Final = 18.0  # age from which men have beards; chosen


@dataclass(frozen=True)
class Outfit:
    """All choices of a subject's appearance; None, "" or 0 for things that are not worn.

    Garments and their albedos: upper, lower, shoes; ``pattern``: of the upper one; ``words``,
    ``numbers``: entries of the manifest, "appearance.name" -> value.
    """

    hair: HairStyle | None = None
    beard: str = ""
    beard_mm: float = 0.0
    brow_mm: float = 0.0
    hair_albedo: float = 0.0
    glasses: str = ""
    lens: str = "clear"
    rim_albedo: float = 0.0
    lens_albedo: float = 0.0
    hat: str = ""
    hat_albedo: float = 0.0
    headphones_albedo: float = 0.0
    hand: str = ""
    garments: tuple[Garment, ...] = ()
    cloth_albedos: tuple[float, ...] = ()
    pattern: Pattern = "plain"
    tucked: bool = False
    seed: int = 0
    words: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)


def sample_outfit(
    settings: AppearanceSettings, seeds: ScopeSeeds, notes: Mapping[str, object] | None = None
) -> Outfit:
    """Sample the outfit of a subject; a pure function of the arguments.

    Each choice has its own random generator: a changed setting changes only one choice. The face's
    notes "age_years" and "woman", if known, influence beards, bald heads and grey hair.
    """
    age, woman = _person(notes or {})
    words: dict[str, str] = {}
    numbers: dict[str, float] = {}

    rng = partial(rng_for, seeds.subject, "appearance")

    def worn(name: str) -> bool:
        return bool(rng(f"share of {name}").random() < getattr(settings, name))

    def note(name: str, value: float, digits: int) -> float:
        numbers[f"appearance.{name}"] = round(value, digits)
        return numbers[f"appearance.{name}"]

    colour = rng("colour")
    name, _, (low, high) = HAIR_COLOURS[_choose(_colour_weights(age), colour)]
    hair_albedo = float(colour.uniform(low, high))
    has_hair = worn("hair")
    # The setting is a share of all people; if the sex is known, men have twice that share.
    of_men = rng("share of beard").random() < settings.beard * (1 if woman is None else 2)
    bearded = bool(of_men and not woman and age >= BEARD_FROM_YEARS)
    choices: dict[str, Any] = {"seed": int(rng("relief").integers(1 << 31))}
    if has_hair:
        draw = rng("hair")
        weights = _hair_weights(age, woman if woman is not None or not bearded else False)
        choices["hair"] = hair = _varied(STYLES[_choose(weights, draw)], draw)
        words["appearance.hair"] = hair.name
        note("hair_length_mm", max(hair.hang, hair.lock[1], hair.top), 1)
    if bearded:
        draw = rng("beard")
        choices["beard"] = words["appearance.beard"] = beard = _row("beard", draw)
        span = STYLE_TABLE["beard"][beard]["length"]
        choices["beard_mm"] = note("beard_length_mm", float(draw.uniform(*span)), 2)
    if worn("brows"):
        choices["brow_mm"] = note("brow_height_mm", float(rng("brows").uniform(0.8, 2.4)), 2)
    if choices.keys() & {"hair", "beard", "brow_mm"}:
        words["appearance.hair_colour"] = name
        choices["hair_albedo"] = note("hair_albedo", hair_albedo, 3)
    if worn("glasses"):
        draw = rng("glasses")
        glasses = [*STYLE_TABLE["glasses"]]
        choices["glasses"] = words["appearance.glasses"] = glasses[draw.integers(len(glasses))]
        choices["lens"] = words["appearance.lenses"] = lens = _one_of(STYLE_TABLE["lenses"], draw)
        choices["rim_albedo"] = note("rim_albedo", float(draw.uniform(*STYLE_TABLE["rims"])), 3)
        if lens != "clear":
            span = STYLE_TABLE["lens_albedo"][lens]
            choices["lens_albedo"] = note("lens_albedo", float(draw.uniform(*span)), 3)
    if worn("cloth"):
        draw = rng("cloth")
        garment = UPPER[_choose(_shares(UPPER, woman), draw)]
        words["appearance.cloth"] = garment.name
        choices["cloth_albedos"] = tuple(
            note(f"{name}_albedo", float(draw.uniform(*_one_of(STYLE_TABLE["cloth"], draw))), 3)
            for name in ("cloth", "trousers", "shoes")
        )
        lower = LOWER[_choose(_shares(LOWER, woman), draw)]
        choices["garments"] = garment, lower, SHOES
        choices["pattern"] = pattern = _one_of(STYLE_TABLE["patterns"], draw)
        words |= {"appearance.lower": lower.name, "appearance.pattern": pattern}
        choices["tucked"] = bool(draw.random() < garment.tucked)
    choices |= _carried(worn, rng, note, choices)
    words |= {f"appearance.{name}": choices[name] for name in ("hat", "hand") if name in choices}
    return Outfit(**{"hair_albedo": hair_albedo, **choices}, words=words, numbers=numbers)


def _carried(
    worn: Callable[[str], bool], rng: Callable[[str], np.random.Generator],
    note: Callable[[str, float, int], float], choices: Mapping[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """Sample a hat or headphones, the hair below, and a hand: name of ``Outfit`` -> value."""
    carried: dict[str, Any] = {"hand": _row("hands", rng("hand"))} if worn("hand") else {}
    if "glasses" in choices and carried.get("hand") == "hand at brow":
        carried["hand"] = "chin on fist"  # not through the lenses
    if worn("hat"):
        name, draw, under_mm = "hat", rng("hat"), UNDER_HAT_MM
        carried["hat"] = _row("hats", draw)
        span = _one_of(STYLE_TABLE["cloth"], draw)
    elif worn("headphones"):
        name, draw, under_mm = "headphones", rng("headphones"), UNDER_BAND_MM
        span = STYLE_TABLE["headphones"]
    else:
        return carried
    carried[f"{name}_albedo"] = note(f"{name}_albedo", float(draw.uniform(*span)), 3)
    if "hair" in choices:
        carried["hair"] = pressed(choices["hair"], under_mm)
    return carried


def _person(notes: Mapping[str, object]) -> tuple[float, bool | None]:
    """Return the age in years (default: 35), and whether the person is a woman (None: unknown)."""
    age, woman = notes.get("age_years"), notes.get("woman")
    years = float(age) if isinstance(age, int | float) else 35.0
    return years, woman if isinstance(woman, bool) else None


def _colour_weights(age: float) -> list[float]:
    """Compute the weights of HAIR_COLOURS at an age: more grey hair from 60 years on."""
    grey = float(np.interp(age, (25, 35, 60, 75), (0.02, 0.5, 5.0, 30.0)))
    return [w * (grey if name == "grey" else 1.0) for name, w, _ in HAIR_COLOURS]


def _shares(choices: Sequence[HairStyle | Garment], woman: bool | None) -> list[float]:
    """Return the weights of styles for a sex; their mean over both sexes if it is unknown."""
    share = 0.5 if woman is None else float(woman)
    return [share * s.women + (1 - share) * s.men for s in choices]


def _hair_weights(age: float, woman: bool | None) -> list[float]:
    can_be_bald = float(np.interp(age, (22, 30, 60), (0.0, 0.6, 2.0))) * (0.1 if woman else 1.0)
    pairs = zip(STYLES, _shares(STYLES, woman), strict=True)
    return [w * (can_be_bald if s.bald or s.recede else 1.0) for s, w in pairs]


def _choose(weights: Sequence[float], rng: np.random.Generator) -> int:
    return int(np.searchsorted(np.cumsum(weights) / np.sum(weights), rng.random(), side="right"))


def _row(table: str, rng: np.random.Generator) -> str:
    """Draw the name of a row of a table of styles by its weight."""
    rows: Mapping[str, Mapping[str, Any]] = STYLE_TABLE[table]
    return [*rows][_choose([row["weight"] for row in rows.values()], rng)]


def _one_of(table: Sequence[tuple[_Choice, float]], rng: np.random.Generator) -> _Choice:
    return table[_choose([share for _, share in table], rng)][0]


def _varied(style: HairStyle, rng: np.random.Generator) -> HairStyle:
    """Vary volume, lengths, relief and parting of a hair style at random."""
    volume, length = rng.uniform(0.85, 1.35), rng.uniform(0.8, 1.2)
    factors = {"top": volume, "side": volume, "back": volume, "hang": length}
    factors |= {name: rng.uniform(*span) for name, span in STYLE_TABLE["factors"].items()}
    scaled: dict[str, Any] = {name: getattr(style, name) * by for name, by in factors.items()}
    scaled["stray"] *= 0.5 + 1.5 * style.lift  # more where hair stands out; chosen
    scaled["parting"] = style.parting * (1.0 if rng.random() < 0.5 else -1.0) + rng.normal(0, 4)
    return replace(style, lock=(style.lock[0] * length, style.lock[1] * length), **scaled)
