"""Symmetric 3 x 3 tensors: packing, isotropic functions, eigenvalues."""

import taichi as ti

JACOBI_SWEEPS = 6


@ti.func
def unpack(state):
    """Return the symmetric matrix of six components."""
    return ti.Matrix([[state[0], state[5], state[4]], [state[5], state[1], state[3]], [state[4], state[3], state[2]]])


@ti.func
def pack(symmetric):
    """Return the six components of a symmetric matrix."""
    return ti.Vector(
        [symmetric[0, 0], symmetric[1, 1], symmetric[2, 2], symmetric[1, 2], symmetric[0, 2], symmetric[0, 1]]
    )


@ti.func
def sphere(value):
    """Return `value` times the unit matrix."""
    return ti.Matrix([[value, 0.0, 0.0], [0.0, value, 0.0], [0.0, 0.0, value]])


@ti.func
def double_dot(a, b):
    """Return a : b."""
    return (a * b).sum()


@ti.func
def power_series(a, coefficients: ti.template()):
    """Return c1 A + c2 A^2 + ... + c6 A^6, by Horner's rule on the three coefficients that Cayley-Hamilton leaves."""
    square = a @ a
    first = a.trace()
    second = 0.5 * (first * first - square.trace())
    third = a.determinant()
    p = ti.Vector([0.0, 0.0, 0.0])
    for power in ti.static(range(5, -1, -1)):
        p += ti.Vector([coefficients[power], 0.0, 0.0])
        p = ti.Vector([p[2] * third, p[0] - p[2] * second, p[1] + p[2] * first])
    return sphere(p[0]) + p[1] * a + p[2] * square


@ti.func
def rotate_pair(a: ti.template(), vectors: ti.template(), row: ti.template(), column: ti.template()):
    """Zero one off-diagonal pair of the symmetric `a` by Jacobi's rotation, and turn `vectors` along."""
    if a[row, column] != 0.0:
        other = ti.static(3 - row - column)
        ratio = (a[column, column] - a[row, row]) / (2.0 * a[row, column])
        tangent = 1.0 / (ti.abs(ratio) + ti.sqrt(ratio * ratio + 1.0))
        if ratio < 0.0:
            tangent = -tangent
        cosine = 1.0 / ti.sqrt(tangent * tangent + 1.0)
        sine = tangent * cosine
        a[row, row] -= tangent * a[row, column]
        a[column, column] += tangent * a[row, column]
        to_row, to_column = a[other, row], a[other, column]
        a[row, column] = 0.0
        a[column, row] = 0.0
        a[other, row] = cosine * to_row - sine * to_column
        a[row, other] = a[other, row]
        a[other, column] = sine * to_row + cosine * to_column
        a[column, other] = a[other, column]
        for axis in ti.static(range(3)):
            along_row, along_column = vectors[axis, row], vectors[axis, column]
            vectors[axis, row] = cosine * along_row - sine * along_column
            vectors[axis, column] = sine * along_row + cosine * along_column


@ti.func
def symmetric_eigen(symmetric):
    """Return the eigenvalues and, as columns, the eigenvectors by cyclic Jacobi rotations."""
    a = symmetric
    vectors = sphere(1.0)
    for _ in range(JACOBI_SWEEPS):
        rotate_pair(a, vectors, 0, 1)
        rotate_pair(a, vectors, 0, 2)
        rotate_pair(a, vectors, 1, 2)
    return ti.Vector([a[0, 0], a[1, 1], a[2, 2]]), vectors


@ti.func
def with_eigenvalues(values, vectors):
    """Return V diag(values) V^T."""
    diagonal = ti.Matrix([[values[0], 0.0, 0.0], [0.0, values[1], 0.0], [0.0, 0.0, values[2]]])
    return vectors @ diagonal @ vectors.transpose()
