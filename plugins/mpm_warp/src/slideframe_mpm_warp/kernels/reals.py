"""What `runtime` chose for this copy of the package: precision, whether threads share nodes, what a transfer keeps."""

import sys

import warp as wp

Real = getattr(sys.modules[__package__], "precision", wp.float32)
# nodes are shared by a card's threads, but a processor's own them
SHARED_NODES = getattr(sys.modules[__package__], "shared_nodes", False)
# whether particles keep a share of their own velocity, for which nodes remember theirs
KEEPS_EXCESS = getattr(sys.modules[__package__], "keeps_excess", False)
# particles that a processor strains at once: as many as its widest vectors hold; a card takes one for each thread
LANES = wp.constant(1 if SHARED_NODES else 16 if Real == wp.float32 else 8)
Vector2 = wp.types.vector(2, Real)
Vector = wp.types.vector(3, Real)
Vector4 = wp.types.vector(4, Real)
Vector6 = wp.types.vector(6, Real)
Matrix = wp.types.matrix((3, 3), Real)
# three columns of moments and one of velocity
Gathered = wp.types.matrix((3, 4), Real)
