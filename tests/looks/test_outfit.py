"""What subjects wear: shares, switches, and dependence on the subject's seed alone."""

from collections import Counter

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.core.seeds import stable_seed
from glsim.looks.outfit import HAIR_COLOURS, sample_outfit
from glsim.looks.styles import STYLES
from tests.support.wardrobe import appearance, keys

PEOPLE = 200


def outfits(**values: object) -> list:
    settings = appearance(**values)
    return [sample_outfit(settings, keys(stable_seed("someone", n))) for n in range(PEOPLE)]


@pytest.mark.parametrize(
    ("name", "what"),
    {"hair": "hair", "beard": "beard", "brows": "brow_mm", "glasses": "glasses", "hat": "hat",
     "headphones": "headphones_albedo", "hand": "hand", "cloth": "garments"}.items(),
)  # fmt: skip
def test_shares_over_people_are_as_set(name: str, what: str) -> None:
    share, worn = 0.4, lambda o: bool(getattr(o, what))
    count = sum(worn(o) for o in outfits(**{name: share}))
    z = (count - share * PEOPLE) / np.sqrt(PEOPLE * share * (1 - share))
    assert abs(z) < 3.5
    assert not any(worn(o) for o in outfits(**{name: 0}))
    assert all(worn(o) for o in outfits(**{name: 1}))


def test_a_switch_changes_nothing_else() -> None:
    for all_on, without in zip(outfits(beard=0), outfits(beard=0, glasses=0), strict=True):
        for name in ("hair", "garments", "hair_albedo", "seed"):
            assert getattr(all_on, name) == getattr(without, name)


def test_the_subject_alone_decides() -> None:
    settings = appearance()
    first = sample_outfit(settings, keys(7))
    assert first == sample_outfit(settings, keys(7)._replace(frame=9, sequence=8))
    assert first != sample_outfit(settings, keys(8))


def test_many_styles_and_colours_are_met() -> None:
    drawn = [o for n in range(5) for o in outfits(hair=1, beard=n / 4)]
    assert len(STYLES) >= 20
    assert len({o.hair.name for o in drawn}) >= 25
    assert {o.words["appearance.hair_colour"] for o in drawn} == {c[0] for c in HAIR_COLOURS}


def test_reflectivity_in_the_infrared_is_in_the_range_of_its_colour() -> None:
    ranges = {name: span for name, _, span in HAIR_COLOURS}
    for outfit in outfits(hair=1):
        low, high = ranges[outfit.words["appearance.hair_colour"]]
        assert low - 5e-4 <= outfit.hair_albedo <= high + 5e-4  # rounded to three digits


def test_age_and_sex_decide_where_they_are_known() -> None:
    settings = appearance(beard=0.5)
    seeds = [keys(stable_seed("known", n)) for n in range(PEOPLE)]
    men = [sample_outfit(settings, s, {"age_years": 40.0, "woman": False}) for s in seeds]
    women = [sample_outfit(settings, s, {"age_years": 40.0, "woman": True}) for s in seeds]
    boys = [sample_outfit(settings, s, {"age_years": 9.0, "woman": False}) for s in seeds]
    old = [sample_outfit(settings, s, {"age_years": 75.0, "woman": True}) for s in seeds]
    assert all(o.beard for o in men)  # half of all is all of the men
    assert not any(o.beard for o in [*women, *boys])
    assert not any(o.hair.bald or o.hair.recede for o in boys if o.hair)
    hang = [np.mean([o.hair.hang > 0 for o in group if o.hair]) for group in (men, women)]
    assert hang[0] < 0.3 < hang[1]
    grey = Counter(o.words["appearance.hair_colour"] for o in old)
    assert grey["grey"] > 0.6 * PEOPLE


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"glasses": 1.5}, "appearance.glasses: .*less than or equal to 1"),
        ({"beard": -0.1}, "appearance.beard: .*greater than or equal to 0"),
        ({"wear": "sometimes"}, "appearance.wear: 'sometimes' is not one of auto, always, never"),
        ({"scarf": 1}, "no such setting 'appearance.scarf'"),
    ],
)
def test_a_bad_setting_is_one_line(setting: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        appearance(**setting)
