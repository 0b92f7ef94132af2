"""Test products against NumPy's, and that their rounding depends on the numbers alone."""

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.core.products import nearest_rotation, norm, principal_axis, product, solve


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("left", "right"),
    [((5000, 3), (3, 3)), ((7, 3), (3, 900)), ((3,), (3, 4)), ((3, 8, 3), (3, 60)), ((9, 4), (4,))],
)
def test_a_product_is_that_of_numpy(
    left: tuple[int, ...], right: tuple[int, ...], dtype: type[Any]
) -> None:
    rng = np.random.default_rng(3)
    a: Any = rng.normal(size=left).astype(dtype)
    b: Any = rng.normal(size=right).astype(dtype)
    found = product(a, b)
    assert found.shape == (a @ b).shape
    assert found.dtype == dtype
    assert found.flags.c_contiguous
    np.testing.assert_allclose(found, a @ b, rtol=0, atol=30 * float(np.finfo(dtype).eps))


@pytest.mark.parametrize("columns", [1, 3, 31, 32, 70])
def test_a_row_has_the_same_bytes_in_any_matrix(columns: int) -> None:
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(201, 5)).astype(np.float32)
    matrix = rng.normal(size=(5, columns)).astype(np.float32)
    whole = product(rows, matrix)
    for part in (slice(0, 1), slice(3, 40), slice(120, 201)):
        np.testing.assert_array_equal(product(rows[part], matrix), whole[part])
    np.testing.assert_array_equal(product(matrix.T, rows.T).T, whole)
    # Each term is rounded by itself: no fused multiply and add.
    expected = rows[:, :1] * matrix[0]
    for term in range(1, 5):
        expected = expected + rows[:, term : term + 1] * matrix[term]
    np.testing.assert_array_equal(whole, expected)


def test_the_nearest_rotation_is_that_of_the_singular_values() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        u, s, vt = np.linalg.svd(rng.normal(size=(3, 3)))
        u[:, 2] *= np.sign(np.linalg.det(u @ vt))
        s = np.maximum(s, 0.02)
        found = nearest_rotation(1e5 * u @ np.diag(s) @ vt)
        np.testing.assert_allclose(found, u @ vt, atol=1e-12)


def test_the_principal_axis_is_that_of_the_singular_values() -> None:
    rng = np.random.default_rng(6)
    for _ in range(50):
        points = rng.normal(size=(400, 3)) * rng.uniform((60, 5, 5), (90, 30, 30)) + 1000
        expected = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
        assert abs(principal_axis(points) @ expected) == pytest.approx(1, abs=1e-12)
        assert norm(principal_axis(points)) == pytest.approx(1, abs=1e-15)


def test_a_system_whose_diagonal_dominates_is_solved() -> None:
    rng = np.random.default_rng(7)
    matrix = -rng.uniform(0, 1, (60, 60))
    np.fill_diagonal(matrix, 70.0)
    right = rng.normal(size=(60, 9))
    np.testing.assert_allclose(solve(matrix, right), np.linalg.solve(matrix, right), atol=1e-14)


#: Files with the number of their calls of BLAS. They choose among few answers that are far from
#: each other: which way a mesh faces, what is an iris, whether a matrix is a rotation; a tilted
#: mesh is turned by tenths of a degree. The twin of
#: a shader blends nine nodes: it agrees with the shader within float32, and promises no bytes.
_DECISIONS = {
    "faces/meshes/nose_template.py": 6,
    "faces/meshes/alignment.py": 11,
    "faces/meshes/face_fit.py": 10,
    "faces/meshes/gltf.py": 1,
    "faces/scans/head_pose.py": 2,
    "faces/sources/d3dfacs.py": 7,
    "noise/twins/any_camera.py": 2,
}
_BLAS = {"dot", "matmul", "tensordot", "inner", "vdot", "det", "svd", "inv", "solve", "qr"}
_BLAS |= {"lstsq", "eig", "eigh", "pinv"}


def _calls_blas(node: ast.AST) -> bool:
    """Whether this is a product of NumPy's, or the length of a vector without an axis."""
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.MatMult)
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
        return False
    length = node.func.attr == "norm" and not any(word.arg == "axis" for word in node.keywords)
    return node.func.attr in _BLAS or length


def test_nothing_between_a_seed_and_a_frame_calls_blas() -> None:
    folders = ("core", "faces", "looks", "noise", "render", "sensors")
    found = {}
    for folder in folders:
        for file in Path("glsim", folder).rglob("*.py"):
            tree = ast.parse(file.read_text(encoding="utf-8"))
            if count := sum(_calls_blas(node) for node in ast.walk(tree)):
                found[file.relative_to("glsim").as_posix()] = count
    assert found == _DECISIONS
