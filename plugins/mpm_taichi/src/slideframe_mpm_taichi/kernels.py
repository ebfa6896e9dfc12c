"""The kernels of the explicit MLS-MPM, in the order in which a substep runs them.

Positions are in cells from the grid's origin; everything else is SI. The elastic state of a particle is
X = b_e - 1 (elastic left Cauchy-Green tensor minus identity) as (xx, yy, zz, yz, xz, xy): small strains
stay small numbers, which a deformation gradient near 1 loses in float32. Between the kernels of one
substep a particle carries `affines` = spacing * (mass * C - stress term), all that the next scatter needs.

`float` is the runtime's default_fp, so one source serves both precisions. Taichi needs this module's
annotations as objects: no `from __future__ import annotations` here.
"""

import taichi as ti

Array = ti.types.ndarray()

# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = 1e-12
JACOBI_SWEEPS = 6

STICK = 1
FRICTION = 2

# A slab of four layers of cells plus a drift of one cell either way never shares a node with the next but one.
SLAB_WIDTH = 4
CHUNK = 256


@ti.func
def arms(offset):
    """Return the way from a particle to its three nodes along one axis; `offset` is from the first node, in cells."""
    return ti.Vector([-offset, 1.0 - offset, 2.0 - offset])


@ti.func
def spline(arm):
    """Return the quadratic B-spline's weights of three nodes."""
    low = 1.5 + arm[0]
    high = 1.5 - arm[2]
    return ti.Vector([0.5 * low * low, 0.75 - arm[1] * arm[1], 0.5 * high * high])


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


@ti.func
def hencky_strain(x, series_radius):
    """Return log(1 + X) / 2: by series within `series_radius`, by eigenvalues beyond."""
    result = x
    if double_dot(x, x) <= series_radius * series_radius:
        result = power_series(x, (1 / 2, -1 / 4, 1 / 6, -1 / 8, 1 / 10, -1 / 12))
    else:
        values, vectors = symmetric_eigen(x)
        result = with_eigenvalues(0.5 * ti.log(ti.max(1.0 + values, SMALLEST_SQUARED_STRETCH)), vectors)
    return result


@ti.func
def state_of(hencky, series_radius):
    """Return X = exp(2 h) - 1: by series within `series_radius`, by eigenvalues beyond."""
    y = 2.0 * hencky
    result = y
    if double_dot(y, y) <= series_radius * series_radius:
        result = power_series(y, (1.0, 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720))
    else:
        values, vectors = symmetric_eigen(y)
        result = with_eigenvalues(ti.exp(values) - 1.0, vectors)
    return result


@ti.func
def return_mapping(trial, correction, cone_slope, series_radius):
    """Return X, the Hencky strain and the volume correction after plastic flow (Klar et al. 2016, eqs. 27 to 29).

    The deviator's direction stays, so trace and norm decide all and no eigenvectors are needed.
    A state inside the cone is returned untouched.
    """
    hencky = hencky_strain(trial, series_radius)
    trace = hencky.trace() + correction
    state = trial
    remaining = 0.0
    if trace >= 0.0:
        remaining = trace
        hencky = sphere(0.0)
        state = sphere(0.0)
    else:
        spherical = sphere(trace / 3.0)
        deviator = hencky - sphere(hencky.trace() / 3.0)
        norm = ti.sqrt(double_dot(deviator, deviator))
        excess = norm + cone_slope * trace
        if excess > 0.0:
            hencky = (1.0 - excess / norm) * deviator + spherical
            state = state_of(hencky, series_radius)
        elif correction > 0.0:
            hencky = deviator + spherical
            state = state_of(hencky, series_radius)
    return state, hencky, remaining


@ti.func
def wall(velocity, axis: ti.template(), inward: ti.template(), kind, friction):
    """Return a node's velocity after one-sided contact with a plane whose normal is `inward` along `axis`."""
    result = velocity
    approach = -inward * velocity[axis]
    if kind == STICK:
        result = ti.Vector([0.0, 0.0, 0.0])
    elif approach > 0.0:
        result[axis] = 0.0
        if kind == FRICTION:
            speed = result.norm()
            # the impulse that stops the approach bounds that of friction (Coulomb)
            if speed <= friction * approach:
                result = ti.Vector([0.0, 0.0, 0.0])
            else:
                result *= 1.0 - friction * approach / speed
    return result


@ti.func
def scatter(position, momentum, affine, mass, stride, grid: ti.template(), exclusive: ti.template()):
    """Add momentum (first three) and mass (last) of one particle to its 27 nodes."""
    first = ti.cast(position - 0.5, ti.i32)
    x_arms, y_arms, z_arms = arms(position[0] - first[0]), arms(position[1] - first[1]), arms(position[2] - first[2])
    x_weights, y_weights, z_weights = spline(x_arms), spline(y_arms), spline(z_arms)
    for a, b in ti.static(ti.ndrange(3, 3)):
        weight = x_weights[a] * y_weights[b]
        node = (first[0] + a) * stride[0] + (first[1] + b) * stride[1] + first[2]
        for c in ti.static(range(3)):
            carried = momentum + affine @ ti.Vector([x_arms[a], y_arms[b], z_arms[c]])
            contribution = weight * z_weights[c] * ti.Vector([carried[0], carried[1], carried[2], mass])
            if ti.static(exclusive):
                grid[node + c] = grid[node + c] + contribution
            else:
                grid[node + c] += contribution


@ti.kernel
def particles_to_grid(
    positions: Array,
    velocities: Array,
    affines: Array,
    masses: Array,
    stride: ti.types.vector(2, ti.i32),
    slab_starts: Array,
    parity: ti.i32,
    grid: Array,
):
    """Scatter the particles of every other slab, in their order: no two threads share a node, so no sum varies."""
    ti.loop_config(block_dim=1)
    for pair in range((slab_starts.shape[0] - 1) // 2):
        slab = 2 * pair + parity
        for p in range(slab_starts[slab], slab_starts[slab + 1]):
            scatter(positions[p], masses[p] * velocities[p], affines[p], masses[p], stride, grid, True)


@ti.kernel
def particles_to_grid_atomic(
    positions: Array, velocities: Array, affines: Array, masses: Array, stride: ti.types.vector(2, ti.i32), grid: Array
):
    """Scatter all particles at once, as a graphics card does best."""
    for p in range(positions.shape[0]):
        scatter(positions[p], masses[p] * velocities[p], affines[p], masses[p], stride, grid, False)


@ti.kernel
def update_grid(
    grid: Array,
    shape: ti.types.vector(3, ti.i32),
    gravity: Array,
    time_step: float,
    padding: ti.i32,
    high: ti.types.vector(2, ti.i32),
    wall_kinds: ti.types.vector(2, ti.i32),
    side_friction: float,
    floor_friction: float,
):
    """Turn momentum into velocity, apply gravity, then the walls; the kinds are of (sides, floor)."""
    ti.loop_config(block_dim=1)
    for i in range(shape[0]):
        for j in range(shape[1]):
            for k in range(shape[2]):
                index = (i * shape[1] + j) * shape[2] + k
                node = grid[index]
                if node[3] > 0.0:
                    v = ti.Vector([node[0], node[1], node[2]]) / node[3] + time_step * gravity[0]
                    if i <= padding:
                        v = wall(v, 0, 1.0, wall_kinds[0], side_friction)
                    if i >= high[0]:
                        v = wall(v, 0, -1.0, wall_kinds[0], side_friction)
                    if j <= padding:
                        v = wall(v, 1, 1.0, wall_kinds[0], side_friction)
                    if j >= high[1]:
                        v = wall(v, 1, -1.0, wall_kinds[0], side_friction)
                    if k <= padding:
                        v = wall(v, 2, 1.0, wall_kinds[1], floor_friction)
                    grid[index] = ti.Vector([v[0], v[1], v[2], node[3]])


@ti.func
def gather(position, stride, grid: ti.template()):
    """Return the velocity and its moment sum of w v (x_i - x_p)^T, in cells, at one particle."""
    first = ti.cast(position - 0.5, ti.i32)
    x_arms, y_arms, z_arms = arms(position[0] - first[0]), arms(position[1] - first[1]), arms(position[2] - first[2])
    x_weights, y_weights, z_weights = spline(x_arms), spline(y_arms), spline(z_arms)
    velocity = ti.Vector([0.0, 0.0, 0.0])
    x_moment, y_moment, z_moment = velocity, velocity, velocity
    for a, b in ti.static(ti.ndrange(3, 3)):
        weight = x_weights[a] * y_weights[b]
        node = (first[0] + a) * stride[0] + (first[1] + b) * stride[1] + first[2]
        row = ti.Vector([0.0, 0.0, 0.0])
        for c in ti.static(range(3)):
            entry = grid[node + c]
            share = weight * z_weights[c] * ti.Vector([entry[0], entry[1], entry[2]])
            row += share
            z_moment += z_arms[c] * share
        velocity += row
        x_moment += x_arms[a] * row
        y_moment += y_arms[b] * row
    return velocity, ti.Matrix.cols([x_moment, y_moment, z_moment])


@ti.kernel
def grid_to_particles(
    grid: Array,
    stride: ti.types.vector(2, ti.i32),
    positions: Array,
    residuals: Array,
    velocities: Array,
    affines: Array,
    elastic_states: Array,
    volume_corrections: Array,
    deformation_gradients: Array,
    held: Array,
    masses: Array,
    volumes: Array,
    time_step: float,
    spacing: float,
    shear_modulus: float,
    lame_lambda: float,
    cone_slope: float,
    shape: ti.types.vector(3, ti.i32),
    series_radius: float,
    fastest: Array,
):
    """Gather velocity and its gradient, move the particle, strain it, and prepare its next scatter.

    `fastest` receives the greatest component of velocity in each chunk of particles.
    """
    ti.loop_config(block_dim=1)
    for chunk in range(fastest.shape[0]):
        chunk_fastest = 0.0
        for particle in range(chunk * CHUNK, ti.min((chunk + 1) * CHUNK, positions.shape[0])):
            position = positions[particle]
            velocity, moment = gather(position, stride, grid)

            # C = 4 / spacing * moment (Jiang et al. 2015: D = spacing^2 / 4 for quadratic splines)
            change = time_step * 4.0 / spacing * moment
            deformation_gradients[particle] += change @ deformation_gradients[particle]
            x = unpack(elastic_states[particle])
            # b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
            half = change + change @ x
            trial = x + half + half.transpose() + half @ change.transpose()
            state, hencky, correction = return_mapping(trial, volume_corrections[particle], cone_slope, series_radius)
            stress = 2.0 * shear_modulus * hencky + sphere(lame_lambda * hencky.trace())
            affines[particle] = 4.0 * masses[particle] * moment - 4.0 * volumes[particle] * time_step / spacing * stress
            elastic_states[particle] = pack(state)
            volume_corrections[particle] = correction
            velocities[particle] = velocity
            residual = residuals[particle]
            for axis in ti.static(range(3)):
                # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
                step = time_step / spacing * velocity[axis] + residual[axis]
                moved = position[axis] + step
                residual[axis] = step - (moved - position[axis])
                # written so that NaN, too, is held: an index made of it would leave the grid
                if not (moved >= 1.0):
                    moved = 1.0
                    residual[axis] = 0.0
                    held[particle] = 1
                if moved > shape[axis] - 2.0:
                    moved = shape[axis] - 2.0
                    residual[axis] = 0.0
                    held[particle] = 1
                position[axis] = moved
                chunk_fastest = ti.max(chunk_fastest, ti.abs(velocity[axis]))
            positions[particle] = position
            residuals[particle] = residual
        fastest[chunk] = chunk_fastest


@ti.kernel
def bound_stretch(deformation_gradients: Array, low: float, high: float):
    """Hold the principal stretches of the rendering frames between two bounds: F <- F V diag(s' / s) V^T."""
    for particle in range(deformation_gradients.shape[0]):
        gradient = deformation_gradients[particle]
        squared, vectors = symmetric_eigen(gradient.transpose() @ gradient)
        stretches = ti.sqrt(ti.max(squared, SMALLEST_SQUARED_STRETCH))
        ratios = ti.min(ti.max(stretches, low), high) / stretches
        if (ratios != 1.0).any():
            deformation_gradients[particle] = gradient @ with_eigenvalues(ratios, vectors)
