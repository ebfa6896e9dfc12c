"""Singular value decomposition of many 3x3 matrices at once, several times faster than LAPACK one by one."""

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array

# Convergence is quadratic: a sweep that met no larger cosine than this leaves none above its square.
ALMOST_ORTHOGONAL = 1e-7
# Nothing is left to turn below this.
SMALLEST_COSINE = 1e-16
MOST_SWEEPS = 12
# A middle singular value below this share of the largest says nothing of its direction.
FLAT = 1e-13
# Matrices taken together: their working set stays in the cache.
BATCH = 4096


def decompose(matrices: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return U (n, 3, 3), sigma (n, 3) and V (n, 3, 3) with A = U diag(sigma) V^T, both rotations proper.

    One-sided Jacobi (Hestenes 1958). Singular values are not sorted. That U has determinant +1 makes
    U V^T the nearest rotation, even of an inverted matrix, whose smallest sigma then is taken as
    positive although the product would need it negative.

    Args:
        matrices: A, (n, 3, 3).
    """
    parts = [_decompose_batch(matrices[i : i + BATCH]) for i in range(0, len(matrices), BATCH)]
    if not parts:
        return np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3, 3))
    left, values, right = (np.concatenate(column) for column in zip(*parts, strict=True))
    return left, values, right


def within(matrices: Float64Array, low: float, high: float) -> npt.NDArray[np.bool_]:
    """Tell of each A (n, 3, 3) whether its singular values lie between the bounds and its determinant is positive.

    That is so where A^T A - low^2 and high^2 - A^T A are positive definite, by their leading minors.
    """
    square = matrices.transpose(0, 2, 1) @ matrices
    identity = np.eye(3)
    above, below = _positive_definite(square - low**2 * identity), _positive_definite(high**2 * identity - square)
    return np.asarray((np.linalg.det(matrices) > 0) & above & below)


def _positive_definite(matrices: Float64Array) -> npt.NDArray[np.bool_]:
    first, second = matrices[:, 0, 0], np.linalg.det(matrices[:, :2, :2])
    return np.asarray((first > 0) & (second > 0) & (np.linalg.det(matrices) > 0))


def _decompose_batch(matrices: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    # columns[k] and right[k] are (3, n): the k-th column of every matrix
    columns = np.ascontiguousarray(matrices.transpose(2, 1, 0), np.float64)
    right = np.zeros_like(columns)
    right[0, 0] = right[1, 1] = right[2, 2] = 1
    for _ in range(MOST_SWEEPS):
        if max([_turn(columns, right, p, q) for p, q in ((0, 1), (0, 2), (1, 2))]) < ALMOST_ORTHOGONAL:
            break
    values = np.sqrt(np.einsum("kin,kin->kn", columns, columns))
    left = columns / np.maximum(values, np.finfo(np.float64).tiny)[:, None]
    _complete(left, values.argmin(axis=0))
    found = left.transpose(2, 1, 0).copy(), values.T.copy(), right.transpose(2, 1, 0).copy()
    flat = np.sort(values, axis=0)[1] <= FLAT * values.max(axis=0)
    if flat.any():
        for array, exact in zip(found, _decompose_flat(matrices[flat]), strict=True):
            array[flat] = exact
    return found


def _decompose_flat(matrices: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Let LAPACK find the directions that a matrix of rank 1 or 0 leaves open."""
    left, values, right = np.linalg.svd(matrices)
    for turned in (left, right := right.transpose(0, 2, 1).copy()):
        turned[:, :, 2] *= np.linalg.det(turned)[:, None]
    return left, values, right


def _turn(columns: Float64Array, right: Float64Array, p: int, q: int) -> float:
    """Turn columns p and q in their plane until they are orthogonal; return the largest cosine before."""
    a, b = columns[p], columns[q]
    aa, bb, ab = (np.einsum("in,in->n", x, y) for x, y in ((a, a), (b, b), (a, b)))
    bound = np.sqrt(aa * bb)
    slack = np.abs(ab) <= SMALLEST_COSINE * bound
    safe = np.where(slack, 1.0, ab)
    zeta = (bb - aa) / (2 * safe)
    tangent = np.where(slack, 0.0, np.copysign(1.0, zeta) / (np.abs(zeta) + np.sqrt(1 + zeta * zeta)))
    cosine = 1 / np.sqrt(1 + tangent * tangent)
    sine = cosine * tangent
    for block in (columns, right):
        first, second = block[p].copy(), block[q]
        block[p] = cosine * first - sine * second
        block[q] = sine * first + cosine * second
    return float(np.max(np.abs(ab) / np.maximum(bound, np.finfo(np.float64).tiny)))


def _complete(left: Float64Array, smallest: np.ndarray) -> None:
    """Replace each smallest column by the cross product of the other two, so that the determinant is +1."""
    every = np.arange(left.shape[2])
    first, second = left[(smallest + 1) % 3, :, every], left[(smallest + 2) % 3, :, every]
    left[smallest, :, every] = np.cross(first, second)
