"""The decoder for the library webdataset: what was written is what is read."""

from pathlib import Path

import numpy as np
import pytest

import glsim
from glsim.core.errors import DatasetError
from glsim.core.files.png import encode_png
from glsim.data.layer_images import webdataset_decoder
from glsim.data.reader import open_dataset
from tests.support.dataset_fakes import make, make_settings, make_tasks

LAYERS = ["clean", "noisy", "infrared", "reason"]


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("shards")
    settings = make_settings(format="webdataset", layers=LAYERS, frames_per_shard=2)
    make(out, settings, make_tasks(2, 3))
    return out


@pytest.mark.filterwarnings("ignore")  # webdataset leaves files open
def test_samples_hold_the_stored_depths_and_checked_records(shards: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    dataset = open_dataset(shards)
    tars = [file for split in ("train", "test") for file in dataset.shards(split)]
    assert len(tars) == 4 == len(list(shards.glob("*.tar")))
    read = webdataset.WebDataset(tars, shardshuffle=False, empty_check=False)
    samples = {s["json"]["index"]: s for s in read.decode(glsim.webdataset_decoder)}
    pairs = list(dataset)
    assert len(samples) == len(pairs) == 6
    for pair in pairs:
        sample = samples[pair.record["index"]]
        assert sample["__key__"] == f"{pair.record['index']:08d}"
        assert sample["json"] == pair.record
        for layer in LAYERS:
            image = sample[f"{layer}.png"]
            if layer in pair:
                assert image.dtype == pair[layer].dtype
                np.testing.assert_array_equal(image, pair[layer])
            else:
                assert image.dtype == np.uint16
                np.testing.assert_allclose(image * pair.step_mm, pair[f"{layer}_mm"])
    assert max(sample["clean.png"].max() for sample in samples.values()) > 255


def test_normals_keep_three_channels_in_their_order() -> None:
    normals = np.arange(2 * 3 * 3, dtype=np.uint16).reshape(2, 3, 3) * 3000
    np.testing.assert_array_equal(webdataset_decoder(".normals.png", encode_png(normals)), normals)


def test_other_members_are_left_to_the_next_decoder() -> None:
    assert webdataset_decoder(".jpg", b"") is None
    assert webdataset_decoder(".photo.png", b"") is None


@pytest.mark.parametrize(
    ("key", "data"),
    [
        (".noisy.png", b"no image"),
        (".noisy.png", encode_png(np.zeros((2, 2), np.uint8))),
        (".noisy.png", encode_png(np.zeros((2, 2, 3), np.uint16))),
        (".json", b'{"index": 1}'),
        (".json", b" " * (1 << 20) + b"{}"),
    ],
)
def test_damage_is_an_error_in_one_line(key: str, data: bytes) -> None:
    with pytest.raises(DatasetError, match="of a shard"):
        webdataset_decoder(key, data)
