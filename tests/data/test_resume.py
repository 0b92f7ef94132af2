"""Test interrupted and damaged runs: the same call afterwards gives the same bytes."""

import logging
import os
import random
import signal
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from glsim.core.errors import ConfigError, DatasetError
from glsim.data.run_identity import InputHashes, refuse_difference
from glsim.data.verification import verify
from glsim.settings.schema import load_settings
from tests.support.dataset_fakes import (
    SKIP,
    Fault,
    children,
    contents,
    make,
    make_settings,
    make_tasks,
)
from tests.support.user_rights import ordinary_user

#: Another quick case covers the same way of failing.
LONG = pytest.mark.long


def resume(out: Path, format: str, expected: dict[str, bytes], **options) -> None:
    make(out, make_settings(format=format), **SKIP, **options)
    assert contents(out) == expected
    assert verify(out, deep=True) == []


def test_a_complete_data_set_is_verified_and_left_alone(tmp_path: Path, undisturbed) -> None:
    make(tmp_path, **SKIP)
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.png")}
    summary = make(tmp_path, workers=2, **SKIP)
    assert (summary.rendered, summary.reused) == (0, 160)
    assert before == {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.png")}
    assert contents(tmp_path) == undisturbed["png"]
    for record in (tmp_path / ".glsim/chunks").iterdir():  # as glsim 0.3 wrote them
        record.write_bytes(zlib.decompress(record.read_bytes()))
    (tmp_path / "manifest.jsonl").unlink()
    assert make(tmp_path, **SKIP).reused == 160
    assert verify(tmp_path, deep=True) == []


@pytest.mark.parametrize(("format", "index"), [("png", 139), ("webdataset", 0)])
def test_a_killed_worker_is_replaced(
    tmp_path: Path, undisturbed, caplog: pytest.LogCaptureFixture, format: str, index: int
) -> None:
    fault = Fault("kill", index, str(tmp_path / "once"))
    with caplog.at_level(logging.WARNING):
        resume(tmp_path / "a", format, undisturbed[format], workers=2, faults=(fault,))
    assert len(caplog.records) == 1
    assert "was killed by SIGKILL (out of memory?) while rendering" in caplog.text


def test_a_chunk_that_kills_every_worker_stops_the_run(tmp_path: Path, undisturbed) -> None:
    others = set(children())  # of tests before, in the same process
    with pytest.raises(DatasetError, match=r"SIGKILL .* for the second time: what is complete is"):
        make(tmp_path, workers=2, faults=(Fault("kill", 77),), **SKIP)
    assert set(children()) <= others
    assert verify(tmp_path)[0].endswith(
        "is not complete: run glsim generate again with the same settings"
    )
    resume(tmp_path, "png", undisturbed["png"])


ROOT = Path(__file__).parents[2]

SCRIPT = """
import signal, sys
from pathlib import Path
from tests.support.dataset_fakes import children, make, make_settings
# Children of a background shell ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    make(Path(sys.argv[1]), make_settings(format=sys.argv[2]), workers=int(sys.argv[3]),
         delay_s=0.01, skip_every=7,
         progress=lambda p: (print(p.done, flush=True), p.done < 10 or signal.pause()))
except KeyboardInterrupt:
    print("interrupted", children())
"""


def start(out: Path, format: str, workers: int) -> subprocess.Popen[str]:
    """Start a script without a main guard; after its first frames it waits for a signal."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(out), format, str(workers)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while int(process.stdout.readline()) < 10:
        pass
    return process


@pytest.mark.parametrize(
    ("format", "workers"), [("png", 1), pytest.param("webdataset", 2, marks=LONG)]
)
def test_interrupt(tmp_path: Path, undisturbed, format: str, workers: int) -> None:
    process = start(tmp_path, format, workers)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate()
    assert output.splitlines()[-1] == "interrupted []"
    assert errors == ""
    assert not (tmp_path / ".glsim" / "temporary").exists()
    resume(tmp_path, format, undisturbed[format], workers=2)


def test_a_killed_run_leaves_a_folder_that_resumes_at_once(tmp_path: Path, undisturbed) -> None:
    process = start(tmp_path, "png", 2)
    with pytest.raises(DatasetError, match="another run is writing here"):
        make(tmp_path, **SKIP)
    process.kill()
    process.communicate()
    resume(tmp_path, "png", undisturbed["png"])


def damage(path: Path, how: str, rng: random.Random) -> None:
    data = bytearray(path.read_bytes())
    if how == "delete":
        path.unlink()
    elif how == "truncate":
        path.write_bytes(data[: rng.randrange(len(data))] if data else b"\n")
    elif how == "garble":
        if data:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data or b"x")


@pytest.mark.parametrize(
    ("format", "how"),
    [
        ("webdataset", "truncate"),
        *(pytest.param("png", how, marks=LONG) for how in ("delete", "garble")),
    ],
)
def test_damaged_files_of_a_complete_data_set_are_restored(
    tmp_path: Path, undisturbed, format: str, how: str
) -> None:
    rng = random.Random(how)
    make(tmp_path, make_settings(format=format), **SKIP)
    names = [name for name in contents(tmp_path) if name != ".glsim/plan.json"]
    special = [name for name in names if not name.endswith(".png")]
    for name in special:
        damage(tmp_path / name, how, rng)
        resume(tmp_path, format, undisturbed[format])
    for name in rng.sample(names, min(len(names), 5)):
        damage(tmp_path / name, how, rng)
    resume(tmp_path, format, undisturbed[format], workers=2)


@pytest.mark.parametrize("how", ["delete", "truncate", "garble"])
def test_damaged_files_of_a_begun_data_set_are_restored(
    tmp_path: Path, undisturbed, how: str, caplog: pytest.LogCaptureFixture
) -> None:
    rng = random.Random(how)
    with pytest.raises(ZeroDivisionError):
        make(tmp_path, faults=(Fault("bug", 117),), **SKIP)
    records = sorted((tmp_path / ".glsim" / "chunks").iterdir())
    assert len(records) >= 3
    damage(records[0], how, rng)
    # These files are in the second chunk: its record stays, and no longer matches.
    for path in rng.sample(sorted(tmp_path.glob("train/s002/*_0001[3-9]_clean.png")), 2):
        damage(path, how, rng)
    with caplog.at_level(logging.WARNING):
        resume(tmp_path, "png", undisturbed["png"])
    assert len(caplog.records) == (1 if how == "delete" else 2)
    assert caplog.text.count("again") == len(caplog.records)


def test_images_of_a_frame_that_is_skipped_now_go(tmp_path: Path, undisturbed) -> None:
    """A mesh was whole during a run whose chunks were then discarded."""
    inputs = iter([InputHashes({"a": "1"}), InputHashes({"a": "2"})])
    with pytest.raises(DatasetError, match="the frames of this run are discarded"):
        make(tmp_path, inputs=lambda: next(inputs))
    skipped = tmp_path / "train/s000/smile.1_00006_noisy.png"
    assert skipped.exists()
    make(tmp_path, inputs=lambda: InputHashes({"a": "1"}), **SKIP)
    assert not skipped.exists()
    assert verify(tmp_path, deep=True) == []
    images = {n: data for n, data in contents(tmp_path).items() if n.endswith(".png")}
    assert images == {n: d for n, d in undisturbed["png"].items() if n.endswith(".png")}


@pytest.mark.parametrize(
    ("format", "name"),
    [("png", ".png"), ("webdataset", "test-000000.tar"), ("png", "dataset.json")],
)
def test_full_disk(tmp_path: Path, undisturbed, format: str, name: str) -> None:
    fault = Fault("full", 0, out=str(tmp_path), name=name)
    with pytest.raises(DatasetError) as caught:
        make(tmp_path, make_settings(format=format), faults=(fault,), **SKIP)
    message = str(caught.value)
    assert message.startswith(f"cannot write {tmp_path}")
    assert "No space left on device: free some space and run the same command again" in message
    assert verify(tmp_path) != []
    resume(tmp_path, format, undisturbed[format])


def test_another_data_set_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(tmp_path)
    before = contents(tmp_path)
    for changes, message in (
        ({"output": {"crop": 128}}, r"was begun with output.crop = null, not 128"),
        ({"pose": {"yaw_deg": 3}}, r"pose.yaw_deg.constant = 0.0, not 3.0"),
        ({"source": {"subjects": 3}}, r"source.subjects = (null|10), not 3"),
    ):
        with pytest.raises(ConfigError, match=message):
            make(tmp_path, load_settings(overrides=changes))
    with pytest.raises(ConfigError, match="was begun with other faces: the files of a source"):
        make(tmp_path, tasks=[*make_tasks()[1:], replace(make_tasks()[0], device=7)])
    with pytest.raises(ConfigError, match="out is a simulated data set: choose a new folder"):
        refuse_difference("out", {"sensor": {"stages": ["tof_floor"]}}, {"sensor": {}})
    with pytest.raises(ConfigError, match='renderer = "fake renderer", not "another"'):
        make(tmp_path, renderer="another")
    with monkeypatch.context() as patch:
        patch.setattr("glsim.data.run_identity.code_version", lambda: "0.3.0+0123abcd")
        with pytest.raises(
            ConfigError, match=r"begun with glsim (\S+), whose .* of 0.3.0\+0123abcd"
        ):
            make(tmp_path)
    assert contents(tmp_path) == before
    (tmp_path / ".glsim" / "plan.json").unlink()  # the header has the same identity
    with pytest.raises(ConfigError, match="planned_frames = 160, not 140"):
        make(tmp_path, tasks=make_tasks(7))


@pytest.mark.parametrize("format", ["png", "webdataset"])
def test_a_run_without_a_frame_does_not_block_its_folder(
    tmp_path: Path, undisturbed, format
) -> None:
    other = load_settings(overrides={"seed": 3, "output": {"format": "webdataset"}})
    assert not any(make(tmp_path, other, skip_every=1).frames.values())
    resume(tmp_path, format, undisturbed[format])


def test_other_folders_are_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(DatasetError, match="is not empty and holds no data set of glsim"):
        make(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(DatasetError, match="is a file: choose a folder"):
        make(tmp_path / "thesis.tex")
    with pytest.raises(DatasetError, match="cannot write /proc/data"):
        make(Path("/proc/data"))


def test_read_only_folder() -> None:
    with ordinary_user() as folder:
        folder.chmod(0o500)
        with pytest.raises(DatasetError, match="Permission denied: check the permissions"):
            make(folder / "a")


def test_a_damaged_plan_is_mended_from_the_header_or_one_clear_line(tmp_path: Path) -> None:
    make(tmp_path)
    plan = tmp_path / ".glsim" / "plan.json"
    sound = contents(tmp_path)
    plan.write_bytes(plan.read_bytes()[:-9])
    make(tmp_path)
    assert contents(tmp_path) == sound
    header = tmp_path / "dataset.json"
    header.write_text(header.read_text().replace('"format_version": 1', '"format_version": 99'))
    with pytest.raises(DatasetError, match="format version 99 is newer than 1"):
        make(tmp_path)
    header.unlink()
    plan.write_text("{")
    with pytest.raises(DatasetError, match=r"plan\.json: is damaged"):
        make(tmp_path)
