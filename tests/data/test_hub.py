"""``glsim export --hf`` against a stand-in of the Hub on this machine, through huggingface_hub."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from glsim.cli import main
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.hub_stand_in import TOKEN, HubStandIn, hub_stand_in

pytest.importorskip("huggingface_hub", reason="needs huggingface_hub: pip install '.[hub]'")


@pytest.fixture
def hub() -> Iterator[HubStandIn]:
    with hub_stand_in() as running:
        yield running


@pytest.fixture
def data(tmp_path: Path) -> Path:
    make(tmp_path / "data", make_settings(), make_tasks(3, 2))
    return tmp_path / "data"


def push(
    data: Path, url: str, *more: str, token: str | None = TOKEN
) -> subprocess.CompletedProcess[str]:
    """Run the command; huggingface_hub reads the environment when it is imported."""
    places = {
        "HF_ENDPOINT": url, "HF_HOME": str(data.parent / "hf"), "HF_HUB_DISABLE_XET": "1",
        "HF_HUB_DISABLE_TELEMETRY": "1", "HF_HUB_DISABLE_PROGRESS_BARS": "1",
    }  # fmt: skip
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("HF_", "HUGGING"))}
    environment |= places | ({} if token is None else {"HF_TOKEN": token})
    return subprocess.run(
        [sys.executable, "-m", "glsim", "export", str(data), *more],
        env=environment, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip


@pytest.mark.long
def test_a_data_set_is_pushed_byte_for_byte_and_only_once(data: Path, hub: HubStandIn) -> None:
    done = push(data, hub.url, "--hf", "me/faces")
    assert done.returncode == 0, done.stderr + str(hub.requests)
    assert f"MB, to {hub.url}/datasets/me/faces" in done.stderr
    assert "left out" not in done.stderr
    assert hub.repositories == {"me/faces": True}, "private"
    expected = {
        path.relative_to(data).as_posix(): path.read_bytes()
        for path in data.rglob("*")
        if path.is_file() and ".glsim" not in path.parts
    }
    assert {"README.md", "dataset.json", "manifest.jsonl"} <= expected.keys()
    assert hub.files == expected
    stored = dict(hub.objects)
    again = push(data, hub.url, "--hf", "me/faces")
    assert again.returncode == 0, again.stderr
    assert hub.objects == stored
    assert hub.files == expected


def test_only_what_the_manifest_names_is_pushed(data: Path, hub: HubStandIn) -> None:
    secret = data.parent / "secret.txt"
    secret.write_text("of another folder")
    named = {p.relative_to(data).as_posix() for p in data.rglob("*") if p.is_file()}
    image = next(data.rglob("*_clean.png"))
    (data / ".env").write_text("TOKEN=1")
    (image.parent / ".image.png.tmp").write_bytes(b"half")
    (data / "train" / "link").symlink_to(secret)
    (data / "folder").symlink_to(data.parent)
    done = push(data, hub.url, "--hf", "me/faces")
    assert done.returncode == 0, done.stderr
    assert hub.files.keys() == {n for n in named if not n.startswith(".glsim/")} | {"README.md"}
    assert f"pushed {len(hub.files)} files" in done.stderr
    assert "left out 4 that the data set does not name: .env" in done.stderr


@pytest.mark.parametrize("damage", ["cut", "changed", "link", "card"])
def test_a_damaged_data_set_is_not_pushed(data: Path, hub: HubStandIn, damage: str) -> None:
    image = next(data.rglob("*_clean.png"))
    content = image.read_bytes()
    if damage == "card":
        (data / "README.md").symlink_to("/etc/hostname")
    elif damage == "link":
        (data.parent / "outside.png").write_bytes(content)
        image.unlink()
        image.symlink_to(data.parent / "outside.png")
    else:
        image.write_bytes(content[:-9] if damage == "cut" else content[:-20] + bytes(20))
    done = push(data, hub.url, "--hf", "me/faces")
    assert done.returncode == 1
    assert ("README.md" if damage == "card" else image.name) in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert hub.files == {}


def test_a_public_repository_is_asked_for(data: Path, hub: HubStandIn) -> None:
    assert push(data, hub.url, "--hf", "me/faces", "--public").returncode == 0
    assert hub.repositories == {"me/faces": False}


@pytest.mark.parametrize(
    ("token", "words"),
    [(None, "no token: run hf auth login"), ("hf_wrong", "was not pushed")],
)
def test_without_the_right_token_nothing_is_pushed(
    data: Path, hub: HubStandIn, token: str | None, words: str
) -> None:
    done = push(data, hub.url, "--hf", "me/faces", token=token)
    assert done.returncode in (1, 2)
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert hub.files == {}


def test_a_hub_that_cannot_be_reached_is_said(data: Path) -> None:
    done = push(data, "http://127.0.0.1:9", "--hf", "me/faces")
    assert done.returncode == 1
    assert "me/faces: was not pushed" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["data"], "give -o, a folder or file, or --hf"),
        (["data", "--public", "-o", "x"], "--public: is of a repository"),
        (["data", "--hf", "me/faces", "-o", "x"], "give no other option"),
        (["none", "--hf", "me/faces"], "no such folder"),
        (["empty", "--hf", "me/faces"], "empty: "),
        (["data", "--hf", "faces"], "give owner/name"),
    ],
)
def test_wrong_arguments(
    data: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(data.parent)
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    (data.parent / "empty").mkdir()
    assert main(["export", *arguments]) in (1, 2)
    assert words in capsys.readouterr().err
