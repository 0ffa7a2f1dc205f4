"""Names of array types."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Array = npt.NDArray[np.float32]
"""What a policy computes with."""
