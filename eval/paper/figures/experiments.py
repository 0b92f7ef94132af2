"""The figure of the experiments: one frame of each, and its error."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from glsim.denoise.frames import Sample
from glsim.eval.paper.cases import FILTERS_FOLDER
from glsim.eval.paper.experiments import EXPERIMENTS, experiment_folder
from glsim.eval.report.figures.map_pictures import (
    colour_legend,
    depth_colours,
    depth_picture,
    error_colours,
    error_picture,
)
from glsim.eval.report.figures.style import new_figure, to_png
from glsim.eval.scoring.pairs import open_frames

#: Columns of a block of two rows.
_COLUMNS: Final = 5
#: Side of a panel, and room for titles, for labels at the sides, and for the legend, inch.
_PANEL_IN, _TITLE_IN, _SIDE_IN, _LEGEND_IN = 1.3, 0.5, 0.8, 0.25
_LABELS: Final = ("noisy depth", "noisy - clean [mm]")
_TEXT_SIZE: Final = 6
#: Letters of a title in a line.
_LETTERS: Final = 23


def draw_experiments(reproduction: Path, names: Sequence[str]) -> bytes | None:
    """Draw the first frame of each experiment: the noisy map above, its error below.

    Args:
        reproduction: the folder of the reproduction.
        names: experiments with data there, in the order of the columns.

    Returns:
        A PNG file; None if the maps of all of them were removed.

    Raises:
        DatasetError: a map cannot be read.
        GlsimError: without Matplotlib.
    """
    shown = {name: sample for name in names if (sample := _first(reproduction, name))}
    if not shown:
        return None
    columns = min(_COLUMNS, len(shown))
    blocks = -(-len(shown) // columns)
    figure = new_figure(
        _PANEL_IN * columns + _SIDE_IN, (2 * _PANEL_IN + _TITLE_IN) * blocks + _LEGEND_IN
    )
    axes = figure.subplots(
        2 * blocks, columns + 1, squeeze=False, width_ratios=[1.0] * columns + [0.06]
    )
    errors = error_colours()
    for axis in axes.ravel():
        axis.set_axis_off()
    for number, (name, sample) in enumerate(shown.items()):
        block, column = divmod(number, columns)
        colours = depth_colours(sample.clean_mm)
        pictures = (
            depth_picture(sample.noisy_mm, colours),
            error_picture(sample.noisy_mm, sample.clean_mm, errors),
        )
        for row, (picture, label) in enumerate(zip(pictures, _LABELS, strict=True)):
            axis = axes[2 * block + row, column]
            axis.imshow(picture, interpolation="nearest")
            axis.set_axis_on()
            axis.set(xticks=[], yticks=[])
            if column == 0:
                axis.set_ylabel(label, fontsize=_TEXT_SIZE)
        title = textwrap.fill(EXPERIMENTS[name].title, _LETTERS)
        axes[2 * block, column].set_title(title, fontsize=_TEXT_SIZE)
    for block in range(blocks):
        bar = axes[2 * block + 1, -1]
        bar.set_axis_on()
        figure.colorbar(errors, cax=bar).ax.tick_params(labelsize=_TEXT_SIZE)
    handles = [handle for handle in colour_legend() if handle.get_label() != "flying pixel"]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=3, fontsize=_TEXT_SIZE, frameon=False
    )
    return to_png(figure)


def _first(reproduction: Path, name: str) -> Sample | None:
    """Load the first test frame of an experiment with dense clean maps; None if it was deleted."""
    folder = experiment_folder(reproduction, name) / FILTERS_FOLDER / "dense"
    data = min(folder.glob("*/data"), default=None)
    if data is None:
        return None
    sample = open_frames(data, "test", protocol="depth").load(0)
    return sample if np.any(sample.clean_mm > 0) else None
