"""What `runtime` chose for this copy of the package: the precision, and whether threads share nodes."""

import sys

import warp as wp

Real = getattr(sys.modules[__package__], "precision", wp.float32)
# nodes are shared by a card's threads, but a processor's own them
SHARED_NODES = getattr(sys.modules[__package__], "shared_nodes", False)
Vector2 = wp.types.vector(2, Real)
Vector = wp.types.vector(3, Real)
Vector4 = wp.types.vector(4, Real)
Vector6 = wp.types.vector(6, Real)
Matrix = wp.types.matrix((3, 3), Real)
# three columns of moments and one of velocity
Gathered = wp.types.matrix((3, 4), Real)
