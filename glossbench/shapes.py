"""Types of arrays: kind and shape. Signatures state them, and the tests check them.

A word in a shape stands for one size, which is the same everywhere in one signature. `*pairs` stands for any number of
sizes, `*#pairs` for sizes that broadcast to them: a value that depends only on the point is (P, 1), one that depends
only on the sample is (1, N), and one for each pair is (P, N).
"""

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from numpy.typing import NDArray
from torch import Tensor

from glossbench.directions import Vec3

# For pairs of directions.
Directions = Float[Vec3, "*#pairs"]
Values = Float[Tensor, "*#pairs"]
Choices = Bool[Tensor, "*#pairs"]
PairDirections = Float[Vec3, "*pairs"]
PairValues = Float[Tensor, "*pairs"]

# For a lobe or a material.
Scalar = Float[Tensor, ""]
UnitSquare = Float[Tensor, "samples 2"]  # points of it

# For all points of a view, or a list of directions.
PointDirections = Float[Vec3, "points"]
Albedo = Float64[Tensor, "points 3"]
Radiance = Float[Tensor, "points 3"]
Irradiance = Float64[Tensor, "points 3"]
Rays = Float[Vec3, "rays"]
Seen = Bool[Tensor, "rays"]

# For images.
Picture = Float[Tensor, "height width 3"]
Mask = Bool[Tensor, "height width"]
Faces = Float[Tensor, "6 edge edge 3"]

# For metrics, which calculate with numpy in double precision.
Colours = Float64[NDArray[np.float64], "height width 3"]
ErrorMap = Float64[NDArray[np.float64], "height width"]
Errors = Float64[NDArray[np.float64], "pixels"]
Masked = Bool[NDArray[np.bool_], "height width"]

# For tables of texels.
Texels = Float32[Tensor, "texels 3"]
