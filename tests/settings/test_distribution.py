"""Distributions: validation, and draws as pure functions of keys and names."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glsim.core.errors import ConfigError
from glsim.settings.distribution import Distribution, ScopeSeeds
from glsim.settings.schema import load_settings
from tests.support.stage_harness import Z_MAX, z_mean, z_rate, z_sd

U64 = st.integers(0, 2**64 - 1)
KEYS = [ScopeSeeds(frame, frame // 10, frame // 100) for frame in range(4000)]


def draws(distribution: Distribution, name: str = "x") -> np.ndarray:
    return np.array([distribution.sample(keys, name) for keys in KEYS])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "give exactly one of constant, uniform, loguniform, normal, choice, not none"),
        ({"uniform": [0, 1], "normal": [0, 1]}, r"exactly one .* not \['uniform', 'normal'\]"),
        ({"uniform": [2, 1]}, r"the range \[2.0, 1.0\] is empty: low comes first"),
        ({"loguniform": [2, 1]}, "is empty: low comes first"),
        ({"loguniform": [0, 1]}, "loguniform needs numbers above 0"),
        ({"normal": [0, -1]}, "needs a deviation of at least 0"),
        ({"choice": []}, "choice needs at least one number"),
        ({"constant": float("nan")}, "numbers must be finite"),
        ({"uniform": [0, float("inf")]}, "numbers must be finite"),
        ({"uniform": [1]}, r"pose.yaw_deg.uniform.1: is missing"),
        ({"unifrom": [1, 2]}, "did you mean 'pose.yaw_deg.uniform'"),
        ({"uniform": [1, 2], "per": "year"}, "pose.yaw_deg.per: 'year' is not one of frame, seq"),
    ],
)
def test_what_is_no_distribution_is_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_settings(overrides={"pose": {"yaw_deg": table}})


@settings(max_examples=50)
@given(U64, U64, U64, st.text(max_size=20))
def test_a_draw_depends_on_its_key_and_name_alone(
    frame: int, sequence: int, subject: int, name: str
) -> None:
    for per, keys in (
        ("frame", ScopeSeeds(frame, 1, 2)),
        ("sequence", ScopeSeeds(1, sequence, 2)),
        ("subject", ScopeSeeds(1, 2, subject)),
    ):
        distribution = Distribution(uniform=(-1, 1), per=per)
        first = distribution.sample(ScopeSeeds(frame, sequence, subject), name)
        np.random.default_rng(5).random(100)
        assert distribution.sample(keys, name) == first
        assert -1 <= first <= 1


def test_draws_are_pinned() -> None:
    """A later version must generate the same data set."""
    keys = ScopeSeeds(1, 2, 3)
    made = [
        Distribution(uniform=(0, 1)).sample(keys, "pose.yaw_deg"),
        Distribution(normal=(0, 1), per="sequence").sample(keys, "axial.base_sigma_mm"),
        Distribution(loguniform=(1, 10), per="subject").sample(keys, "x"),
        Distribution(choice=(1, 2, 3, 4)).sample(keys, "x"),
    ]
    assert made == pytest.approx(
        [0.7501487766190287, 1.1114258607910077, 2.8413984275320874, 3.0], rel=1e-12
    )


def test_normal_is_cut_at_three_deviations() -> None:
    distribution = Distribution(normal=(10, 2))
    made = draws(distribution)
    assert abs(z_mean(made, 10)) < Z_MAX
    assert abs(z_sd(made, 2 * np.sqrt(0.99))) < Z_MAX + 1  # the cut takes a percent of the variance
    assert distribution.bounds() == (4, 16)
    assert made.min() >= 4
    assert made.max() <= 16
    assert (draws(Distribution(normal=(1, 0))) == 1).all()


def test_choice_takes_each_as_often() -> None:
    made = draws(Distribution(choice=(1, 2, 4)))
    assert set(made) == {1, 2, 4}
    for value in (1, 2, 4):
        assert abs(z_rate(made == value, 1 / 3)) < Z_MAX


@pytest.mark.parametrize(("per", "distinct"), [("frame", 4000), ("sequence", 400), ("subject", 40)])
def test_per_says_how_often_a_number_is_drawn(per: str, distinct: int) -> None:
    made = draws(Distribution.model_validate({"uniform": [0, 1], "per": per}))
    assert len(set(made)) == distinct


def test_a_number_of_hundreds_of_digits_is_refused() -> None:
    with pytest.raises(ConfigError, match="the number is too large"):
        load_settings(assignments=["pose.distance_mm=" + "9" * 400])


def test_numbers_of_a_device_are_the_middle_for_the_first_and_drawn_for_others() -> None:
    spreads = {
        "uniform": ((1.0, 1.3), 1.15),
        "loguniform": ((1600.0, 2500.0), 2000.0),
        "normal": ((4.0, 1.0), 4.0),
        "choice": ((7.0, 8.0), 7.0),
    }
    for kind, (numbers, middle) in spreads.items():
        given = Distribution.model_validate({kind: numbers, "per": "device"})
        assert given.sample(ScopeSeeds(1, 2, 3), "x") == pytest.approx(middle)
        assert given.sample(ScopeSeeds(9, 8, 7), "x") == pytest.approx(middle)
    given = Distribution(uniform=(1.0, 1.3), per="device")
    drawn = [given.sample(ScopeSeeds(1, 2, 3, device), "x") for device in range(200)]
    assert len(set(drawn)) == 200
    assert np.mean(drawn) == pytest.approx(1.15, abs=0.03)
    assert given.sample(ScopeSeeds(5, 6, 7, 11), "x") == drawn[11], "of the device alone"
