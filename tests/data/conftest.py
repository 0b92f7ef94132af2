"""What several tests of data sets compare with."""

import pytest

from tests.support.dataset_fakes import FORMATS, SKIP, contents, make, make_settings


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bytes]]:
    """Make the set that runs with faults must end with: format -> file -> bytes."""
    result = {}
    for format in FORMATS:
        out = tmp_path_factory.mktemp("undisturbed") / format
        make(out, make_settings(format=format), **SKIP)
        result[format] = contents(out)
    return result
