"""Export of a data set's frames to file formats of other programs.

``frames`` reads what is exported, ``formats`` holds the formats, ``write`` finds them by name;
``hub`` pushes a data set as it is.
"""

from glsim.data.export.hub import push_dataset
from glsim.data.export.write_formats import FORMATS, export_dataset

__all__ = ["FORMATS", "export_dataset", "push_dataset"]
