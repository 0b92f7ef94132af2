"""Read the scores of a reproduction in its four cases.

The paper does not say where depths are counted from, nor whether its clean maps have holes. So all
is scored in four cases: a protocol (``glsim.depth_protocol``) times a mask of the clean maps, which
are dense, or BlenSor's: without depth where the noisy map has none.

    FOLDER/filters/MASK/SEED/PROTOCOL   the filters, on a data set per seed of people and noise
    ``case_folder``                     the networks

Each holds table.csv of ``glsim eval``, and baselines.csv with a map of zeros and the mean face.
"""

from __future__ import annotations

import csv
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, get_args

from glsim.denoise import PAPER_FILTERS
from glsim.depth_protocol import DepthProtocol
from glsim.errors import ConfigError, DatasetError
from glsim.eval.paper.filter_table import NOTHING_LOSES_TO
from glsim.eval.paper.runs import SeedGroup, find_trained_runs, group_by_network, with_twins
from glsim.files.atomic import wrap_read_errors

#: Folder of the filters' data sets and scores in that of a reproduction.
FILTERS_FOLDER: Final = "filters"
#: ``output.clean_mask`` -> what it is, in pages.
MASKS: Final = {"dense": "dense clean maps", "as-noisy": "BlenSor's mask"}
#: The metrics that the pages of all cases need.
CASE_METRICS: Final = (
    *("mse_mm2", "psnr_db", "ssim_paper", "ssim_16bit", "mse_flips_pct", "flips_px"),
    "both_interior_rmse_mm",
)

#: The composite of networks that are no rows of the paper: without clean frames, no network
#: learns which pixels have depth.
OWN_COMPOSITE: Final = "input mask"

#: Method -> metric -> mean over frames.
Means = dict[str, dict[str, float]]


@dataclass(frozen=True)
class NetworkScores:
    """The scores of a network in one case.

    Attributes:
        group: its trainings, one per seed.
        values: metric -> mean over frames of each seed.
        baseline: metric -> mean of the noisy input on the same frames.
    """

    group: SeedGroup
    values: dict[str, list[float]]
    baseline: dict[str, float]


@dataclass
class PaperCase:
    """The scores of all rows in one case.

    Attributes:
        protocol: where depths are counted from.
        mask: of the clean maps, a key of MASKS.
        values: filter or trivial prediction -> metric -> mean of each seed of the data.
        frames: of the filters, over all seeds.
        networks: row of tables 2 and 3 -> its scores; empty before a reproduction trained any.
        others: title -> scores of the networks that are no rows of the paper, those without clean
            frames among them.
    """

    protocol: DepthProtocol
    mask: str
    values: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    frames: int = 0
    networks: dict[str, NetworkScores] = field(default_factory=dict)
    others: dict[str, NetworkScores] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Name the case as tables do: its depth protocol and its mask of clean maps."""
        return f"protocol {self.protocol}, {MASKS.get(self.mask, self.mask)}"

    def mean(self, name: str, metric: str) -> float:
        """Return the mean of a metric of a filter over the seeds."""
        return statistics.fmean(self.values[name][metric])

    def ratios(self, name: str) -> list[float]:
        """Divide the MSE of a filter by the noisy input's, seed by seed.

        Args:
            name: of the filter, or of a trivial prediction.

        Returns:
            The ratios, without seeds in which the noisy input has no error.
        """
        pairs = zip(self.values[name]["mse_mm2"], self.values["noisy"]["mse_mm2"], strict=True)
        return [value / base for value, base in pairs if base > 0]


def mask_folder(out: Path, mask: str) -> Path:
    """Return the folder of the data, networks and tables of one mask of clean maps.

    Args:
        out: folder of the reproduction, which holds those with dense clean maps itself.
        mask: of the clean maps, a key of MASKS.
    """
    return out if mask == "dense" else out / f"mask_{mask}"


def case_folder(out: Path, protocol: DepthProtocol, mask: str = "dense") -> Path:
    """Return the folder of the networks and tables of one case, a depth protocol and a mask.

    Args:
        out: folder of the reproduction.
        protocol: where depths are counted from.
        mask: of the clean maps, a key of MASKS.
    """
    folder = mask_folder(out, mask)
    return folder if protocol == "depth" else folder / f"protocol_{protocol}"


def read_cases(folder: Path) -> list[PaperCase]:
    """Read all scores of a reproduction.

    Args:
        folder: of ``glsim paper reproduce``.

    Returns:
        The four cases. One without scores has empty tables.

    Raises:
        DatasetError: for a table that cannot be read.
    """
    return [
        _read_case(folder, PaperCase(protocol, mask))
        for protocol in get_args(DepthProtocol)
        for mask in MASKS
    ]


def read_filter_cases(folder: Path) -> list[PaperCase]:
    """Read the scores of a reproduction, without the cases in which no filter was scored.

    Args:
        folder: of ``glsim paper reproduce``.

    Raises:
        DatasetError: if there is none, or for a table that cannot be read.
    """
    cases = [case for case in read_cases(folder) if case.values]
    if not cases:
        raise DatasetError(
            f"{folder / FILTERS_FOLDER}: holds no scores: run glsim paper reproduce -o {folder} "
            "first"
        )
    return cases


def read_means(path: Path) -> Means:
    """Read a table of ``glsim eval``.

    Args:
        path: table.csv or baselines.csv.

    Returns:
        Method -> metric -> mean over frames.

    Raises:
        DatasetError: the file cannot be read, or is another table.
    """
    means: Means = {}
    for row in _rows(path):
        try:
            means.setdefault(row["method"], {})[row["metric"]] = float(row["mean"])
        except (KeyError, TypeError, ValueError) as error:
            raise DatasetError(f"{path}: is no table of glsim eval: {error!r}") from None
    return means


def _rows(path: Path) -> list[dict[str, str]]:
    with wrap_read_errors(path):
        return list(csv.DictReader(path.read_text().splitlines()))


def _read_case(folder: Path, case: PaperCase) -> PaperCase:
    for seed in sorted((folder / FILTERS_FOLDER / case.mask).glob("*")):
        path = seed / case.protocol / "table.csv"
        if path.is_file():
            _add_seed(case, path)
    place = case_folder(folder, case.protocol, case.mask)
    if (place / "table.csv").is_file() and (place / "runs").is_dir():
        _add_networks(case, place)
    return case


def _add_seed(case: PaperCase, path: Path) -> None:
    """Add a data set's scores of the filters and of the trivial predictions to a case."""
    means = {name: values for name, values in read_means(path).items() if name in PAPER_FILTERS}
    trivial = path.with_name("baselines.csv")
    if trivial.is_file():
        means |= {n: v for n, v in read_means(trivial).items() if n in NOTHING_LOSES_TO}
    try:
        case.frames += max(int(row["frames"]) for row in _rows(path))
        for name, values in means.items():
            of_name = case.values.setdefault(name, {})
            for metric in CASE_METRICS:
                of_name.setdefault(metric, []).append(values[metric])
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetError(f"{path}: is no table of glsim eval: {error!r}") from None


def _add_networks(case: PaperCase, place: Path) -> None:
    """Add the scores of the trained networks; of several sizes of a row the largest, as printed."""
    means = read_means(place / "table.csv")
    baseline = {metric: means["noisy"][metric] for metric in CASE_METRICS}
    for group in sorted(_groups(place / "runs"), key=lambda group: group.size == "full"):
        labels = [run.label for run in group.members]
        if group.row is None:
            labels = [f"{label} [{OWN_COMPOSITE}]" for label in labels]
        scored = [means[label] for label in labels if label in means]
        if not scored:
            continue
        values = {metric: [of_seed[metric] for of_seed in scored] for metric in CASE_METRICS}
        scores = NetworkScores(group, values, baseline)
        if group.row is None:
            case.others[f"{group.title} [{OWN_COMPOSITE}]"] = scores
        else:
            case.networks[group.row] = scores


def _groups(runs: Path) -> Sequence[SeedGroup]:
    try:
        return with_twins(group_by_network(find_trained_runs(runs)[0]))
    except ConfigError:  # nothing was trained there
        return ()
