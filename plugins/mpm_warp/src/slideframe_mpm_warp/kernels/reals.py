"""The types of numbers, vectors and matrices, in the precision that `runtime` chose for this copy of the package."""

import sys

import warp as wp

Real = getattr(sys.modules[__package__], "precision", wp.float32)
Vector2 = wp.types.vector(2, Real)
Vector = wp.types.vector(3, Real)
Vector4 = wp.types.vector(4, Real)
Vector6 = wp.types.vector(6, Real)
Matrix = wp.types.matrix((3, 3), Real)
