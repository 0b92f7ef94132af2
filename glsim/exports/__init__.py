"""Exports: the frames of a data set in the formats of other programs.

``frames`` reads what is exported, ``formats`` holds the formats, ``write`` finds them by name.
"""

from glsim.exports.write import FORMATS, export_dataset

__all__ = ["FORMATS", "export_dataset"]
