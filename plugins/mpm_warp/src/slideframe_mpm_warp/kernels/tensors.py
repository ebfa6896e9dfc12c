"""Symmetric 3 x 3 tensors: packing, isotropic functions, eigenvalues."""

import warp as wp

from .reals import Matrix, Real, Vector, Vector6

wp.set_module_options({"enable_backward": False})


@wp.func
def unpack(state: Vector6) -> Matrix:
    """Return the symmetric matrix of six components."""
    return Matrix(state[0], state[5], state[4], state[5], state[1], state[3], state[4], state[3], state[2])


@wp.func
def pack(symmetric: Matrix) -> Vector6:
    """Return the six components of a symmetric matrix."""
    return Vector6(symmetric[0, 0], symmetric[1, 1], symmetric[2, 2], symmetric[1, 2], symmetric[0, 2], symmetric[0, 1])


@wp.func
def power_series(a: Matrix, c1: Real, c2: Real, c3: Real, c4: Real, c5: Real, c6: Real) -> Matrix:
    """Return c1 A + c2 A^2 + ... + c6 A^6, by Horner's rule on the three coefficients that Cayley-Hamilton leaves."""
    square = a * a
    first = wp.trace(a)
    second = Real(0.5) * (first * first - wp.trace(square))
    third = wp.determinant(a)
    p = Vector(c6, Real(0.0), Real(0.0))
    p = Vector(p[2] * third + c5, p[0] - p[2] * second, p[1] + p[2] * first)
    p = Vector(p[2] * third + c4, p[0] - p[2] * second, p[1] + p[2] * first)
    p = Vector(p[2] * third + c3, p[0] - p[2] * second, p[1] + p[2] * first)
    p = Vector(p[2] * third + c2, p[0] - p[2] * second, p[1] + p[2] * first)
    p = Vector(p[2] * third + c1, p[0] - p[2] * second, p[1] + p[2] * first)
    p = Vector(p[2] * third, p[0] - p[2] * second, p[1] + p[2] * first)
    return wp.diag(Vector(p[0], p[0], p[0])) + p[1] * a + p[2] * square


@wp.func
def rotate_pair(symmetric: Matrix, turned: Matrix, row: int, column: int):
    """Zero one off-diagonal pair of a symmetric matrix by Jacobi's rotation, and turn eigenvectors along."""
    a = symmetric
    vectors = turned
    if a[row, column] != Real(0.0):
        other = 3 - row - column
        ratio = (a[column, column] - a[row, row]) / (Real(2.0) * a[row, column])
        tangent = Real(1.0) / (wp.abs(ratio) + wp.sqrt(ratio * ratio + Real(1.0)))
        if ratio < Real(0.0):
            tangent = -tangent
        cosine = Real(1.0) / wp.sqrt(tangent * tangent + Real(1.0))
        sine = tangent * cosine
        to_row = a[other, row]
        to_column = a[other, column]
        shift = tangent * a[row, column]
        a[row, row] = a[row, row] - shift
        a[column, column] = a[column, column] + shift
        a[row, column] = Real(0.0)
        a[column, row] = Real(0.0)
        a[other, row] = cosine * to_row - sine * to_column
        a[row, other] = cosine * to_row - sine * to_column
        a[other, column] = sine * to_row + cosine * to_column
        a[column, other] = sine * to_row + cosine * to_column
        for axis in range(3):
            along_row = vectors[axis, row]
            along_column = vectors[axis, column]
            vectors[axis, row] = cosine * along_row - sine * along_column
            vectors[axis, column] = sine * along_row + cosine * along_column
    return a, vectors


@wp.func
def symmetric_eigen(symmetric: Matrix, sweeps: int):
    """Return the eigenvalues and, as columns, the eigenvectors by cyclic Jacobi rotations."""
    a = symmetric
    vectors = wp.identity(3, dtype=Real)
    for _ in range(sweeps):
        a, vectors = rotate_pair(a, vectors, 0, 1)
        a, vectors = rotate_pair(a, vectors, 0, 2)
        a, vectors = rotate_pair(a, vectors, 1, 2)
    return Vector(a[0, 0], a[1, 1], a[2, 2]), vectors


@wp.func
def with_eigenvalues(values: Vector, vectors: Matrix) -> Matrix:
    """Return V diag(values) V^T."""
    return vectors * wp.diag(values) * wp.transpose(vectors)
