"""What every test may use: one OpenGL context for the session, and strict arithmetic."""

from collections.abc import Iterator
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from moderngl import Context

from glsim.core.mesh import Mesh
from glsim.gl.context import make_current, open_context
from tests.support.scenes import face_mesh

# No test passes or fails by wall time: a busy machine is no error. Examples may share a folder.
hypothesis.settings.register_profile(
    "busy", deadline=None, suppress_health_check=list(hypothesis.HealthCheck)
)
hypothesis.settings.load_profile("busy")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--regenerate", action="store_true", help="write the golden frames instead of comparing"
    )


@pytest.fixture(scope="session", autouse=True)
def _strict_arithmetic() -> Iterator[None]:
    """An overflow, an invalid operation or a division by zero in NumPy is an error.

    Underflow is not: exp(-1000) is 0, as it should be, and numpy.testing itself underflows.
    """
    before = np.seterr(divide="raise", over="raise", invalid="raise")
    yield
    np.seterr(**before)


@pytest.fixture(scope="session")
def _session_context() -> Iterator[Context]:
    opened = open_context()
    yield opened
    opened.release()


@pytest.fixture
def context(_session_context: Context) -> Context:
    """The session's context, current again whatever the test before has opened."""
    make_current(_session_context)
    return _session_context


@pytest.fixture(scope="session")
def face() -> Mesh:
    """The analytic face, the same object for all tests."""
    return face_mesh()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in which the test works, as a user in a shell."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
