"""Hashes of a data set's input files: noise stages, and files of face sources."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from glsim.core.errors import ConfigError
from glsim.core.files.contents import content_hash, text_hash
from glsim.core.plugins import plugin_code
from glsim.data.run_identity import InputHashes
from glsim.faces.face_source import FaceSource
from glsim.gl.includes import flatten, read_shader
from glsim.noise.stage import Stage
from glsim.settings.source_settings import shipped_kinds
from glsim.simulation.plan.tasks import Task, people_of


def stage_hashes(stages: Sequence[Stage]) -> dict[str, str]:
    """Hash the current files of noise stages: file -> hash.

    For a Python stage, the file of its function is hashed, but no file that it imports. For a stage
    of another package, all code of that package is hashed.
    Raises ShaderError for a GLSL file that cannot be read any more.
    """
    hashes: dict[str, str] = {}
    for stage in stages:
        package = plugin_code("stages", stage.spec.name)
        hashes |= {name: content_hash(path) for name, path in package.items()}
        if stage.spec.source is None:
            code = getattr(stage.spec.function, "__code__", None)
            file = code.co_filename if code is not None else stage.spec.file
            hashes[stage.spec.file] = content_hash(Path(file))
            continue
        texts: dict[str, list[str]] = defaultdict(list)
        for line in flatten(read_shader(Path(stage.spec.file)), Path(stage.spec.file)):
            texts[line.file].append(line.text)
        hashes |= {file: text_hash("\n".join(lines)) for file, lines in texts.items()}
    return dict(sorted(hashes.items()))


def refuse_other_inputs(
    expected: InputHashes, sources: Sequence[FaceSource], tasks: Sequence[Task], where: str
) -> None:
    """Raise ConfigError if this machine's input files of some tasks differ from ``expected``.

    ``expected``: hashes of the whole data set's inputs, from the machine that drives the run.
    """
    for source, files in source_hashes(sources, tasks).items():
        theirs = expected.sources.get(source, {})
        for name, hash in files.items():
            if theirs.get(name) != hash:
                raise ConfigError(
                    f"{where}: source {source}: {name} is not the driver's file: give every "
                    "machine the same files in the same place"
                )


def source_hashes(
    sources: Sequence[FaceSource], tasks: Sequence[Task]
) -> dict[str, dict[str, str]]:
    """Hash the files from which the frames of ``tasks`` are made: source -> file -> hash.

    For a source of another package, the code of that package is hashed, too.
    """
    subjects: dict[int, dict[str, None]] = defaultdict(dict)
    for person in people_of(tasks):
        subjects[person.source][person.name] = None
    hashes = {}
    for number, source in enumerate(sources):
        if number not in subjects:
            continue
        files = source.contents([*subjects[number]])
        if source.name not in shipped_kinds():
            code = plugin_code("sources", source.name)
            files |= {name: content_hash(file) for name, file in code.items()}
        if files:
            hashes[f"{number} {source.name}"] = dict(sorted(files.items()))
    return hashes
