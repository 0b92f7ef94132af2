"""Table 1 under all cases: means over seeds, ratios, relations, and what follows from them."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim.errors import DatasetError
from glsim.eval.paper.cases import read_filter_cases
from glsim.eval.paper.printed_values import PRINTED_FILTERS
from glsim.eval.paper.protocol_page import (
    largest_ratio_difference,
    protocol_document,
    relations,
)
from tests.support.paper_scores import write_scores


def mse(base: float, **ratios: float) -> dict[str, float]:
    return {"noisy": base, "adaptive": base} | {name: base * r for name, r in ratios.items()}


PRINTED_RATIOS = {
    name: PRINTED_FILTERS[name].mse_mm2 / PRINTED_FILTERS["noisy"].mse_mm2
    for name in ("median", "nlm", "bilateral")
}


def test_cases_are_means_over_seeds(tmp_path: Path) -> None:
    for seed, factor in ((1, 1.0), (2, 3.0)):
        write_scores(tmp_path, "dense", seed, "paper", mse(400 * factor, **PRINTED_RATIOS))
        write_scores(
            tmp_path, "as-noisy", seed, "depth", mse(1411.0, median=2, nlm=1.01, bilateral=0.99)
        )
    cases = {case.title: case for case in read_filter_cases(tmp_path)}
    assert list(cases) == ["protocol depth, BlenSor's mask", "protocol paper, dense clean maps"]
    paper = cases["protocol paper, dense clean maps"]
    assert paper.frames == 100
    assert paper.mean("noisy", "mse_mm2") == pytest.approx(800)
    assert paper.ratios("nlm") == pytest.approx([PRINTED_RATIOS["nlm"]] * 2)
    assert largest_ratio_difference(paper) == pytest.approx(0, abs=1e-9)
    assert "face" not in paper.values

    text = protocol_document(list(cases.values())).markdown()
    assert "| printed | 1.000 | 1.000 | 0.965 | 0.813 | 0.956 |" in text
    assert "| protocol paper, dense clean maps | 800.0 ± 565.7 |" in text
    assert "| protocol paper, dense clean maps | 2 of 2 | 2 of 2 | 2 of 2 | 2 of 2 |" in text
    assert "| protocol depth, BlenSor's mask | 0 of 2 | 0 of 2 | 2 of 2 | 2 of 2 |" in text
    assert "| printed | 9.92 ± 0.35 (rounding) | 10.29 ± 0.37 (rounding) |" in text
    assert "| protocol paper, dense clean maps | 9.00 ± 0.00 | 9.00 ± 0.00 |" in text
    assert "of the baseline is nearest to that of protocol paper, dense clean maps." in text
    assert "The printed ratios are nearest to those of protocol paper, dense clean maps." in text
    assert (
        "The printed baseline is nearest to that of protocol depth, BlenSor's mask: a factor 1.0."
        in text
    )


def test_the_printed_table_has_its_relations() -> None:
    assert all(relations({n: row.mse_mm2 for n, row in PRINTED_FILTERS.items()}).values())


def test_scores_that_are_missing_or_damaged(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"filters: holds no scores: run glsim paper reproduce"):
        read_filter_cases(tmp_path)
    path = write_scores(tmp_path, "dense", 1, "paper", mse(400, **PRINTED_RATIOS))
    path.write_text(path.read_text().replace("frames", "pictures"))
    with pytest.raises(DatasetError, match=r"table.csv: is no table of glsim eval"):
        read_filter_cases(tmp_path)
