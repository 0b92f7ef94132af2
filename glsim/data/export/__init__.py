"""Export of a data set's frames to file formats of other programs, or for the Hugging Face Hub.

``exported_frame`` reads the frames, ``formats`` has the formats, ``write_formats`` finds a format
by its name, ``hub_folder`` copies a data set with its card.
"""

from glsim.data.export.write_formats import FORMATS, export_dataset

__all__ = ["FORMATS", "export_dataset"]
