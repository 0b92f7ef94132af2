"""The values that the paper prints in tables 1 to 3, and the texts of pages about them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

from glsim.settings.toml_tables import read_toml


class PrintedRow(NamedTuple):
    """A row of a table in the paper: title as printed, MSE in mm^2, PSNR in dB."""

    title: str
    mse_mm2: float
    psnr_db: float
    ssim: float


_TABLES: Final = read_toml(Path(__file__).with_suffix(".toml"))
#: Table 1: our name of a filter -> its row.
PRINTED_FILTERS: Final = {name: PrintedRow(*row) for name, row in _TABLES["filters"].items()}
#: Tables 2 (Restormer, UNet) and 3 (DnCNN by depth; AR: with artefact removal).
PRINTED_NETWORKS: Final = {row: PrintedRow(row, *v) for row, v in _TABLES["networks"].items()}
#: Row -> the row of the same method; verdict -> its rule.
COPIES: Final[dict[str, str]] = _TABLES["copies"]
VERDICTS: Final[dict[str, str]] = _TABLES["verdicts"]
#: Page -> name of a text -> the text.
TEXTS: Final[dict[str, dict[str, Any]]] = read_toml(Path(__file__).with_name("page_texts.toml"))
