"""One particle and its 27 nodes on a processor: nine rows of three nodes, each node four SIMD lanes.

Warp's compiler finds little to vectorise in the loops of `nodes.py`: these lanes, which Clang knows as vector types,
are more than twice as fast (benchmarks/mpm.py). The two modules do the same sums.
"""

import warp as wp

from .reals import Gathered, Matrix, Real, Vector, Vector4
from .stencils import Stencil

wp.set_module_options({"enable_backward": False})

_REAL = "float" if Real == wp.float32 else "double"
_NODE = f"typedef {_REAL} Real; typedef Real Node __attribute__((ext_vector_type(4)));"


@wp.func_native(
    _NODE
    + """
    Node* nodes = (Node*)grid.data;
    const int* corner = (const int*)columns.data + stencil.column;
    const Node own = {momentum[0], momentum[1], momentum[2], mass};
    const Node along_x = {affine.data[0][0], affine.data[1][0], affine.data[2][0], 0};
    const Node along_y = {affine.data[0][1], affine.data[1][1], affine.data[2][1], 0};
    const Node along_z = {affine.data[0][2], affine.data[1][2], affine.data[2][2], 0};
    const wp::vec_t<3, Real> &x = stencil.x_arms, &y = stencil.y_arms, &z = stencil.z_arms;
    const wp::vec_t<3, Real>&u = stencil.x_weights, &v = stencil.y_weights, &w = stencil.z_weights;
    const Node low = w[0] * (own + z[0] * along_z);
    const Node middle = w[1] * (own + z[1] * along_z);
    const Node high = w[2] * (own + z[2] * along_z);
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
            Node* row = nodes + corner[a * across + b] + stencil.layer;
            const Node sideways = x[a] * along_x + y[b] * along_y;
            const Real share = u[a] * v[b];
            row[0] += share * (low + w[0] * sideways);
            row[1] += share * (middle + w[1] * sideways);
            row[2] += share * (high + w[2] * sideways);
        }
    """
)
def scatter(
    grid: wp.array(dtype=Vector4),
    columns: wp.array(dtype=int),
    across: int,
    stencil: Stencil,
    momentum: Vector,
    affine: Matrix,
    mass: Real,
):
    """Add momentum (first three) and mass (last) of one particle to its 27 nodes; no other thread may touch them."""


@wp.func_native(
    _NODE
    + """
    const Node* nodes = (const Node*)grid.data;
    const int* corner = (const int*)columns.data + stencil.column;
    const wp::vec_t<3, Real> &x = stencil.x_arms, &y = stencil.y_arms, &z = stencil.z_arms;
    const wp::vec_t<3, Real>&u = stencil.x_weights, &v = stencil.y_weights, &w = stencil.z_weights;
    // by layer of nodes: the sum over all rows, and its first moments in x and y
    Node sum0 = 0, sum1 = 0, sum2 = 0, x0 = 0, x1 = 0, x2 = 0, y0 = 0, y1 = 0, y2 = 0;
    for (int a = 0; a < 3; ++a) {
        Node plane0 = 0, plane1 = 0, plane2 = 0, turn0 = 0, turn1 = 0, turn2 = 0;
        for (int b = 0; b < 3; ++b) {
            const Node* row = nodes + corner[a * across + b] + stencil.layer;
            const Node low = row[0], middle = row[1], high = row[2];
            const Real share = v[b], moment = v[b] * y[b];
            plane0 += share * low, plane1 += share * middle, plane2 += share * high;
            turn0 += moment * low, turn1 += moment * middle, turn2 += moment * high;
        }
        const Real share = u[a], moment = u[a] * x[a];
        sum0 += share * plane0, sum1 += share * plane1, sum2 += share * plane2;
        x0 += moment * plane0, x1 += moment * plane1, x2 += moment * plane2;
        y0 += share * turn0, y1 += share * turn1, y2 += share * turn2;
    }
    const Node velocity = w[0] * sum0 + w[1] * sum1 + w[2] * sum2;
    const Node x_moment = w[0] * x0 + w[1] * x1 + w[2] * x2;
    const Node y_moment = w[0] * y0 + w[1] * y1 + w[2] * y2;
    const Node z_moment = w[0] * z[0] * sum0 + w[1] * z[1] * sum1 + w[2] * z[2] * sum2;
    wp::mat_t<3, 4, Real> gathered;
    for (int axis = 0; axis < 3; ++axis) {
        gathered.data[axis][0] = x_moment[axis];
        gathered.data[axis][1] = y_moment[axis];
        gathered.data[axis][2] = z_moment[axis];
        gathered.data[axis][3] = velocity[axis];
    }
    return gathered;
    """
)
def gather(grid: wp.array(dtype=Vector4), columns: wp.array(dtype=int), across: int, stencil: Stencil) -> Gathered:
    """Return the moment sum of w v (x_i - x_p)^T, in cells, and as the last column the velocity, at one particle."""
    ...
