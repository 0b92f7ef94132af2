"""Types of arrays, named by the numbers that they hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Numbers of any shape in double precision, as measures and geometry compute.
Array = NDArray[np.float64]
#: Numbers of any shape in single precision, as files, GPUs and networks hold them.
Floats = NDArray[np.float32]
#: Numbers of any shape in either precision.
Reals = NDArray[np.floating[Any]]
#: Whole numbers: indices, labels, counts.
Whole = NDArray[np.int64]
#: (F, 3) indices of the vertices of triangles.
Triangles = NDArray[np.int32]
#: (H, W) millimetres along the optical axis; 0 = no depth.
Depth = NDArray[np.float32]
#: Marked pixels, (H, W), such as pixels with depth; or marked points, (N,).
Mask = NDArray[np.bool_]
#: (H, W) in [0, 1]: probability that a pixel has depth.
Probability = NDArray[np.floating[Any]]
