"""The arrays that pass between denoisers and metrics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: (H, W) float32 millimetres along the optical axis; 0 = no depth.
Depth = NDArray[np.float32]
#: (H, W) bool: where there is depth.
Mask = NDArray[np.bool_]
#: (H, W) float in [0, 1]: how sure a method is that there is depth.
Probability = NDArray[np.floating]
