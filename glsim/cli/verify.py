"""``glsim verify``: check a data set, and print the command that repairs it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from glsim.cli.common import JsonOption, make_console, print_json, print_message
from glsim.core.errors import DatasetError, GlsimError, counted, printable

#: Largest number of printed problems; a lost folder causes thousands.
_SHOWN = 200
#: Settings of ``generate`` that have their own option in ``glsim import``.
_IMPORT_OPTIONS = ("every", "subjects", "frames_per_subject")


def verify(
    dataset: Path,
    deep: Annotated[bool, typer.Option("--deep")] = False,
    repair: Annotated[bool, typer.Option("--repair")] = False,
    as_json: JsonOption = False,
) -> int:
    """Check a data set's header, counts, splits and lists; find files without a record.

    Prints one line per problem. The exit status is 1 if there is a problem. Nothing is changed.

    Args:
        dataset: Folder of a data set, or its URL, such as s3://bucket/faces.
        deep: Also read every image: CRC32, size, and members of shards.
        repair: Print the command that makes the damaged files again.
    """
    from glsim.core.files.cloud import cloud_url
    from glsim.data.reader import open_dataset
    from glsim.data.verification import STRAY
    from glsim.data.verification import verify as find_problems

    problems = find_problems(dataset, deep=deep)
    place = cloud_url(dataset) or dataset
    counts = {} if problems else open_dataset(dataset).header["frames"]
    if as_json:
        command = repair_command(dataset) if repair else None
        print_json({"problems": problems, "frames": counts, "repair": command})
        return 1 if problems else 0
    out = make_console(soft_wrap=True)
    for problem in problems[:_SHOWN]:
        out.print(printable(problem))
    if len(problems) > _SHOWN:
        out.print(f"and {len(problems) - _SHOWN} more")
    if repair:
        out.print(repair_command(dataset))
    if problems:
        if not repair and not all(problem.endswith(STRAY) for problem in problems):
            with suppress(GlsimError):  # it is no data set: the problem says what to do
                repair_command(dataset)
                print_message(f"glsim verify {place} --repair prints the command that repairs it")
        return 1
    frames = ", ".join(f"{split} {count}" for split, count in counts.items())
    depth = "every image was read" if deep else "images were not read: --deep does"
    print_message(f"{place}: sound: {counted(sum(counts.values()), 'frame')} ({frames}); {depth}")
    return 0


def repair_command(dataset: Path) -> str:
    """Return the command that made a data set; it repairs damaged files when run again.

    Raises DatasetError if neither dataset.json nor the plan in .glsim can be read.
    """
    from glsim.core.files.cloud import open_store
    from glsim.data.state_folder import RunState

    store = open_store(dataset)
    begun = RunState(store).begun()
    if begun is None:
        raise DatasetError(f"{store}: holds no data set of glsim: name another folder or URL")
    return _command(str(store), begun)


def _command(dataset: str, header: Mapping[str, Any]) -> str:
    """Return ``glsim generate`` with all non-default settings, or ``glsim import``.

    Raises GlsimError if the settings are not those of this version.
    """
    from glsim.settings.schema import Settings
    from glsim.settings.toml_tables import parse_table, toml_value

    settings = parse_table(Settings, header.get("settings", {}), dataset)
    tree = settings.model_dump(mode="json", exclude_none=True)
    default = Settings().model_dump(mode="json", exclude_none=True)
    words = ["glsim", "generate", "-o", dataset]
    sensor = header.get("sensor", {}).get("name")
    source = tree["source"][0]
    if (source["kind"], sensor) in (("biwi", "biwi"), ("kinect2", "recording")):
        words = ["glsim", "import", source["kind"], source.get("root", ""), "-o", dataset]
        for name in (name for name in _IMPORT_OPTIONS if name in source):
            words += [f"--{name.replace('_', '-')}", str(source[name])]
        if tree["split"] != default["split"]:
            shares = tree["split"]
            words += ["--split", shares if isinstance(shares, str) else ",".join(map(str, shares))]
        # The header lacks these two options; their effect is in the depth files.
        more = " # and --depth-unit-mm and --mirror as before"
        return shlex.join(words) + (more if source["kind"] == "kinect2" else "")
    for name, value in tree.items():
        if value != default.get(name):
            words += ["--set", f"{name}={toml_value(value)}"]
    return shlex.join(words)
