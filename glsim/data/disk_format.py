"""The file names and the format version of a data set on disk.

    dataset.json                     header: settings, sensor, counts, checksums of the files below
    manifest.jsonl                   one record per frame, by split and then in the plan's order
    skipped.jsonl                    frames that could not be made, and why
    train|val|test/<subject>/<sequence>_<frame>_<layer>.png     format "png"
    train|val|test/metadata.jsonl    the records as rows for Hugging Face's image-folder loader
    train-000000.tar ...             format "webdataset": <index>.<layer>.png, <index>.json
    README.md                        card, in the copy that glsim export --to hf makes
    .glsim/                          lock, plan, chunk records, temporary files; no data

<index> is the frame's position in the plan, eight digits.
"""

from __future__ import annotations

FORMAT = "glsim"
#: Version of the format; increase it with a change that readers of older versions would misread.
FORMAT_VERSION = 1

HEADER = "dataset.json"
MANIFEST = "manifest.jsonl"
SKIPPED = "skipped.jsonl"
METADATA = "metadata.jsonl"
README = "README.md"
STATE = ".glsim"
#: The header's size and CRC32, written last.
COMPLETE = f"{STATE}/complete.json"
