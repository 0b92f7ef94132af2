"""The cards of a data set: README.md for the Hugging Face Hub, and croissant.json.

Both are functions of the header, so that the same data set has the same bytes. The Hub reads the
YAML at the top of README.md; Croissant is the format of MLCommons, version 1.0, which search
engines and the library mlcroissant read.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from glsim.dataset.disk_format import CROISSANT, HEADER, MANIFEST, README
from glsim.depth_protocol import MEANING, stored_protocol
from glsim.settings.schema import SPLIT_NAMES

#: Names of splits on the Hub.
_HUB_SPLITS: Final = {"train": "train", "val": "validation", "test": "test"}
#: The Hub's classes of size: their upper limit and name.
_SIZES: Final = (
    (10**3, "n<1K"),
    (10**4, "1K<n<10K"),
    (10**5, "10K<n<100K"),
    (10**6, "100K<n<1M"),
    (10**7, "1M<n<10M"),
)
_LARGEST: Final = "10M<n<100M"
#: Source of faces -> licence of frames of them, as the Hub names it (docs/licence.md). Nobody
#: claims rights in what glsim computes by itself, nor in results of MakeHuman's body model (CC0);
#: of other faces the owners decide.
_LICENCES: Final = {"procedural": "cc0-1.0", "people": "cc0-1.0", "ict-facekit": "mit"}
#: Licence -> its page. A frame of several sources is under the last one of them.
_LICENCE_PAGES: Final = {
    "cc0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "mit": "https://opensource.org/license/mit",
}
#: Column of the manifest -> its type in Croissant and what it is.
_COLUMNS: Final = {
    "index": ("sc:Integer", "position in the plan of the data set"),
    "split": ("sc:Text", "train, val or test"),
    "subject": ("sc:Text", "the person"),
    "sequence": ("sc:Text", "the sequence of the person"),
    "frame": ("sc:Integer", "number within the sequence"),
    "time_s": ("sc:Float", "seconds since the start of the sequence"),
    "source": ("sc:Text", "the source of the face"),
}


def hub_card(header: Mapping[str, Any]) -> bytes:
    """Return README.md: YAML for the Hub, then what is in the data set and how to read it."""
    counts = {split: header["frames"][split] for split in SPLIT_NAMES}
    total = sum(counts.values())
    size = next((name for limit, name in _SIZES if total < limit), _LARGEST)
    tree = header["settings"]["output"]["format"] == "png"
    yaml = [
        "---",
        f"license: {_licence(header) or 'other'}",
        *([] if _licence(header) else [f"license_name: {_UNKNOWN_LICENCE}"]),
        f"pretty_name: {json.dumps(_title(header))}",
        "task_categories:",
        "- image-to-image",
        "- depth-estimation",
        "tags:",
        *(f"- {tag}" for tag in ("depth", "denoising", "faces", "glsim")),
        *(["- synthetic"] if _simulated(header) else []),
        "size_categories:",
        f"- {size}",
    ]
    if total:
        yaml += ["configs:", "- config_name: default", "  data_files:"]
    for split in (split for split in SPLIT_NAMES if counts[split]):
        path = f"{split}/**" if tree else f"{split}-*.tar"
        yaml += [f"  - split: {_HUB_SPLITS[split]}", f"    path: {json.dumps(path)}"]
    people = {split: len(names) for split, names in header["subjects"].items()}
    rows = [f"| {split} | {counts[split]} | {people.get(split, 0)} |" for split in SPLIT_NAMES]
    units = [f"| {name} | {text} |" for name, text in sorted(header["units"].items())]
    unit_mm = header["depth_unit_mm"]
    text = [
        f"# {_title(header)}",
        "",
        f"{total} {_kind(header)} frames of a depth camera, written by glsim "
        f"{header['glsim_version']}. "
        f"Sensor: {header['sensor'].get('title') or _sensor(header)}.",
        f"Layers: {', '.join(header['settings']['output']['layers'])}. Depth is 16-bit, in steps "
        f"of {unit_mm:g} mm; 0 = no return.",
        *_moved(header),
        "",
        "| split | frames | subjects |",
        "|---|---|---|",
        *rows,
        "",
        "No subject is in two splits." if _apart(header) else "Splits share subjects.",
        "",
        "| what | unit |",
        "|---|---|",
        *units,
        "",
        "## How to read it",
        "",
        "```python",
        *(_TREE_CODE if tree else _SHARD_CODE),
        "```",
        "",
        f"`{HEADER}` holds all settings and the checksum of every listed file, `{MANIFEST}` one "
        f"record per frame, `{CROISSANT}` the same description for machines. `glsim verify` "
        f"compares this file too: change a copy of `{README}` when you publish the data.",
        "",
        "## Licence and citation",
        "",
        _licence_text(header),
        "",
        "```bibtex",
        *_bibtex(header),
        "```",
    ]
    return "\n".join([*yaml, "---", "", *text]).encode() + b"\n"


_UNKNOWN_LICENCE: Final = "that-of-the-faces"


def _licence(header: Mapping[str, Any]) -> str:
    """Return the licence of the frames as the Hub names it; "" if the owners of faces decide."""
    kinds = {str(source["kind"]) for source in header["settings"].get("source", [])}
    if not kinds or not _simulated(header) or kinds - _LICENCES.keys():
        return ""
    found = {_LICENCES[kind] for kind in kinds}
    return next(name for name in reversed(_LICENCE_PAGES) if name in found)


def _licence_text(header: Mapping[str, Any]) -> str:
    licence = _licence(header)
    if licence == "cc0-1.0":
        return f"CC0 1.0 ({_LICENCE_PAGES[licence]}): these faces were computed, of nobody."
    if licence:
        return (
            f"MIT ({_LICENCE_PAGES[licence]}), that of the face model: keep its copyright notice."
        )
    return "The licence is that of the faces, which glsim does not know: ask their owners."


def _bibtex(header: Mapping[str, Any]) -> tuple[str, ...]:
    """Return how to cite the program that made the data: as CITATION.cff."""
    return (
        "@software{glsim,",
        "  title = {glsim}, author = {{The glsim authors}},",
        f"  version = {{{header['glsim_version']}}},",
        "  note = {Simulator of depth cameras that makes pairs of clean and noisy depth frames}",
        "}",
    )


def _moved(header: Mapping[str, Any]) -> list[str]:
    """Return a line if depths are not those from the camera."""
    nearest_mm = header["settings"]["output"].get("nearest_to_mm")
    if nearest_mm is None:
        return []
    what = f"the nearest point of each frame at {nearest_mm:g} mm"
    if stored_protocol(nearest_mm) == "paper":
        what = f"protocol paper: {MEANING['paper']}"
    return [f"Depth is moved ({what}); add `depth_offset_mm` of a record for its distance."]


_TREE_CODE: Final = (
    "from datasets import load_dataset  # images keep their 16 bits",
    "",
    'data = load_dataset("imagefolder", data_dir="PATH OF THIS FOLDER")',
    "",
    "from glsim import open_dataset",
    "",
    'for pair in open_dataset("PATH OF THIS FOLDER").split("train"):',
    "    pair.clean_mm, pair.noisy_mm, pair.intrinsics",
)
_SHARD_CODE: Final = (
    "from glsim import open_dataset  # the decoders of webdataset cut 16 bits to 8",
    "",
    'for pair in open_dataset("PATH OF THIS FOLDER").split("train"):',
    "    pair.clean_mm, pair.noisy_mm, pair.intrinsics",
)


def croissant(header: Mapping[str, Any], manifest_sha256: str) -> bytes:
    """Return croissant.json: the manifest with its columns, and the images or shards."""
    tree = header["settings"]["output"]["format"] == "png"
    files = [
        {
            "@type": "cr:FileObject",
            "@id": MANIFEST,
            "name": MANIFEST,
            "description": "one record per frame",
            "contentUrl": MANIFEST,
            "encodingFormat": "application/jsonlines",
            "sha256": manifest_sha256,
        }
    ]
    if tree:
        files += [
            _file_set(layer, f"*/*/*_{layer}.png", "image/png", f"the images of layer {layer}")
            for layer in header["settings"]["output"]["layers"]
        ]
    else:
        files.append(_file_set("shards", "*.tar", "application/x-tar", "WebDataset shards"))
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"frames/{name}",
            "name": f"frames/{name}",
            "description": text,
            "dataType": kind,
            "source": {"fileObject": {"@id": MANIFEST}, "extract": {"column": name}},
        }
        for name, (kind, text) in _COLUMNS.items()
    ]
    content = {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": f"glsim-{_sensor(header)}",
        "description": f"{_title(header)}: {sum(header['frames'].values())} {_kind(header)} frames",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "version": "1.0.0",
        "license": _LICENCE_PAGES.get(_licence(header), _licence_text(header)),
        "citeAs": " ".join(_bibtex(header)),
        "distribution": files,
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "frames",
                "name": "frames",
                "description": f"the first columns of {MANIFEST}",
                "key": {"@id": "frames/index"},
                "field": fields,
            }
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False).encode() + b"\n"


def _file_set(name: str, includes: str, kind: str, text: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileSet",
        "@id": name,
        "name": name,
        "description": text,
        "encodingFormat": kind,
        "includes": includes,
    }


def _simulated(header: Mapping[str, Any]) -> bool:
    """Whether the true depth is known, as it never is of a real camera's recordings."""
    return "clean" in header["settings"]["output"]["layers"]


def _kind(header: Mapping[str, Any]) -> str:
    return "simulated" if _simulated(header) else "recorded"


def _sensor(header: Mapping[str, Any]) -> str:
    return str(header["sensor"].get("name", "sensor"))


def _title(header: Mapping[str, Any]) -> str:
    kinds = sorted({str(s["kind"]) for s in header["settings"].get("source", [])})
    return f"Depth of {' and '.join(kinds) or 'given'} faces seen by {_sensor(header)}"


def _apart(header: Mapping[str, Any]) -> bool:
    names = [name for split in header["subjects"].values() for name in split]
    return len(names) == len(set(names))


#: The terms of Croissant 1.0 (docs.mlcommons.org/croissant/docs/croissant-spec.html, "Context"),
#: and the two that the library mlcroissant 1.1 asks for besides: equivalentProperty, samplingRate.
_CONTEXT: Final = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataBiases": "cr:dataBiases",
    "dataCollection": "cr:dataCollection",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "personalSensitiveInformation": "cr:personalSensitiveInformation",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
