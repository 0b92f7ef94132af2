"""Exports: the frames of a data set in the formats of other programs.

``frames`` reads what is exported; ``cameras`` converts principal points; ``points`` makes clouds;
``write`` chooses the writers by the names of the formats.
"""

from glsim.exports.write import FORMATS, export_dataset

__all__ = ["FORMATS", "export_dataset"]
