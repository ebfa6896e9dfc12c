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
def trace_of(state):
    """Return the trace of a symmetric matrix given by six components."""
    return state[0] + state[1] + state[2]


@ti.func
def squared_norm(state):
    """Return A : A of a symmetric matrix given by six components."""
    normal = state[0] * state[0] + state[1] * state[1] + state[2] * state[2]
    return normal + 2.0 * (state[3] * state[3] + state[4] * state[4] + state[5] * state[5])


@ti.func
def with_sphere(state, value):
    """Return six components of a symmetric matrix, the unit matrix times `value` added."""
    return ti.Vector([state[0] + value, state[1] + value, state[2] + value, state[3], state[4], state[5]])


@ti.func
def twice_symmetric_part(a):
    """Return the six components of A + A^T."""
    return ti.Vector(
        [
            a[0, 0] + a[0, 0],
            a[1, 1] + a[1, 1],
            a[2, 2] + a[2, 2],
            a[1, 2] + a[2, 1],
            a[0, 2] + a[2, 0],
            a[0, 1] + a[1, 0],
        ]
    )


@ti.func
def symmetric_product(a, b):
    """Return the six components of A B^T, which must be symmetric."""
    return ti.Vector(
        [
            a[row, 0] * b[column, 0] + a[row, 1] * b[column, 1] + a[row, 2] * b[column, 2]
            for row, column in ti.static(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)))
        ]
    )


@ti.func
def square_of(state):
    """Return the six components of A^2."""
    xx, yy, zz, yz, xz, xy = state[0], state[1], state[2], state[3], state[4], state[5]
    return ti.Vector(
        [
            xx * xx + xy * xy + xz * xz,
            xy * xy + yy * yy + yz * yz,
            xz * xz + yz * yz + zz * zz,
            xy * xz + yy * yz + yz * zz,
            xx * xz + xy * yz + xz * zz,
            xx * xy + xy * yy + xz * yz,
        ]
    )


@ti.func
def determinant_of(state):
    """Return the determinant of a symmetric matrix given by six components."""
    xx, yy, zz, yz, xz, xy = state[0], state[1], state[2], state[3], state[4], state[5]
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)


@ti.func
def power_series(state, coefficients: ti.template()):
    """Return c1 A + c2 A^2 + ... + c6 A^6, by Horner's rule on the three coefficients that Cayley-Hamilton leaves.

    `state` has A's six components, as the result has its own.
    """
    square = square_of(state)
    first = trace_of(state)
    second = 0.5 * (first * first - trace_of(square))
    third = determinant_of(state)
    # c4 1 + c5 A + c6 A^2, then times A plus the next coefficient, and so on
    p, q, r = coefficients[3], coefficients[4], coefficients[5]
    for power in ti.static(range(2, -1, -1)):
        p, q, r = coefficients[power] + r * third, p - r * second, q + r * first
    return with_sphere((p - r * second) * state + (q + r * first) * square, r * third)


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
