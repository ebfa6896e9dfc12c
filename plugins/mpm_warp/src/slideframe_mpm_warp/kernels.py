"""The kernels of the explicit MLS-MPM, in the order in which a substep runs them.

Positions are in cells from the grid's origin; everything else is SI. The elastic state of a particle is
X = b_e - 1 (elastic left Cauchy-Green tensor minus identity) as (xx, yy, zz, yz, xz, xy): small strains
stay small numbers, which a deformation gradient near 1 loses in float32. Between the kernels of one
substep a particle carries `affines` = spacing * (mass * C - stress term), all that the next scatter needs.

Warp mixes no precisions, so the solver loads this module once for each, with `Real` set beforehand.
"""

import warp as wp

Real = globals().get("Real", wp.float32)
Vector2 = wp.types.vector(2, Real)
Vector = wp.types.vector(3, Real)
Vector4 = wp.types.vector(4, Real)
Vector6 = wp.types.vector(6, Real)
Matrix = wp.types.matrix((3, 3), Real)

wp.set_module_options({"enable_backward": False})

# The series for log(1 + X) and exp(Y) - 1 end with the sixth power. Within this norm the first neglected
# term, of relative size norm^6 / 7, is below the rounding of the type.
SERIES_RADIUS = wp.constant(Real(0.08 if Real == wp.float32 else 0.003))
# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = wp.constant(Real(1e-12))

SLIP = wp.constant(0)
STICK = wp.constant(1)
FRICTION = wp.constant(2)


@wp.func
def arms(offset: Real) -> Vector:
    """Return the way from a particle to its three nodes along one axis; `offset` is from the first node, in cells."""
    return Vector(-offset, Real(1.0) - offset, Real(2.0) - offset)


@wp.func
def spline(arm: Vector) -> Vector:
    """Return the quadratic B-spline's weights of three nodes."""
    low = Real(1.5) + arm[0]
    high = Real(1.5) - arm[2]
    return Vector(Real(0.5) * low * low, Real(0.75) - arm[1] * arm[1], Real(0.5) * high * high)


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


@wp.func
def hencky_strain(x: Matrix, sweeps: int) -> Matrix:
    """Return log(1 + X) / 2."""
    if wp.ddot(x, x) <= SERIES_RADIUS * SERIES_RADIUS:
        return power_series(
            x, Real(1.0 / 2.0), Real(-1.0 / 4.0), Real(1.0 / 6.0), Real(-1.0 / 8.0), Real(1.0 / 10.0), Real(-1.0 / 12.0)
        )
    values, vectors = symmetric_eigen(x, sweeps)
    for axis in range(3):
        values[axis] = Real(0.5) * wp.log(wp.max(Real(1.0) + values[axis], SMALLEST_SQUARED_STRETCH))
    return with_eigenvalues(values, vectors)


@wp.func
def state_of(hencky: Matrix, sweeps: int) -> Matrix:
    """Return X = exp(2 h) - 1."""
    y = Real(2.0) * hencky
    if wp.ddot(y, y) <= SERIES_RADIUS * SERIES_RADIUS:
        return power_series(
            y, Real(1.0), Real(1.0 / 2.0), Real(1.0 / 6.0), Real(1.0 / 24.0), Real(1.0 / 120.0), Real(1.0 / 720.0)
        )
    values, vectors = symmetric_eigen(y, sweeps)
    for axis in range(3):
        values[axis] = wp.exp(values[axis]) - Real(1.0)
    return with_eigenvalues(values, vectors)


@wp.func
def return_mapping(trial: Matrix, correction: Real, cone_slope: Real, sweeps: int):
    """Return X, the Hencky strain and the volume correction after plastic flow (Klar et al. 2016, eqs. 27 to 29).

    The deviator's direction stays, so trace and norm decide all and no eigenvectors are needed.
    A state inside the cone is returned untouched.
    """
    hencky = hencky_strain(trial, sweeps)
    trace = wp.trace(hencky) + correction
    state = trial
    remaining = Real(0.0)
    if trace >= Real(0.0):
        remaining = trace
        hencky = Matrix()
        state = Matrix()
    else:
        spherical = wp.diag(Vector(trace / Real(3.0), trace / Real(3.0), trace / Real(3.0)))
        mean = wp.trace(hencky) / Real(3.0)
        deviator = hencky - wp.diag(Vector(mean, mean, mean))
        norm = wp.sqrt(wp.ddot(deviator, deviator))
        excess = norm + cone_slope * trace
        if excess > Real(0.0):
            hencky = (Real(1.0) - excess / norm) * deviator + spherical
            state = state_of(hencky, sweeps)
        elif correction > Real(0.0):
            hencky = deviator + spherical
            state = state_of(hencky, sweeps)
    return state, hencky, remaining


@wp.func
def wall(velocity: Vector, axis: int, inward: Real, kind: int, friction: Real) -> Vector:
    """Return a node's velocity after one-sided contact with a plane whose normal is `inward` along `axis`."""
    if kind == STICK:
        return Vector()
    approach = -inward * velocity[axis]
    if approach <= Real(0.0):
        return velocity
    along = velocity
    along[axis] = Real(0.0)
    if kind == FRICTION:
        speed = wp.length(along)
        # the impulse that stops the approach bounds that of friction (Coulomb)
        if speed <= friction * approach:
            return Vector()
        along = along * (Real(1.0) - friction * approach / speed)
    return along


@wp.kernel
def particles_to_grid(
    positions: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    masses: wp.array(dtype=Real),
    stride: wp.vec2i,
    grid: wp.array(dtype=Vector4),
):
    """Scatter momentum (first three) and mass (last) of every particle to its 27 nodes."""
    particle = wp.tid()
    position = positions[particle]
    i = int(position[0] - Real(0.5))
    j = int(position[1] - Real(0.5))
    k = int(position[2] - Real(0.5))
    x_arms = arms(position[0] - Real(i))
    y_arms = arms(position[1] - Real(j))
    z_arms = arms(position[2] - Real(k))
    x_weights = spline(x_arms)
    y_weights = spline(y_arms)
    z_weights = spline(z_arms)
    mass = masses[particle]
    momentum = mass * velocities[particle]
    affine = affines[particle]
    for a in range(3):
        for b in range(3):
            weight = x_weights[a] * y_weights[b]
            node = (i + a) * stride[0] + (j + b) * stride[1] + k
            for c in range(3):
                carried = momentum + affine * Vector(x_arms[a], y_arms[b], z_arms[c])
                share = weight * z_weights[c]
                wp.atomic_add(grid, node + c, share * Vector4(carried[0], carried[1], carried[2], mass))


@wp.kernel
def update_grid(
    grid: wp.array3d(dtype=Vector4),
    velocity_change: Vector,
    padding: int,
    high: wp.vec2i,
    wall_kinds: wp.vec2i,
    wall_frictions: Vector2,
):
    """Turn momentum into velocity, apply gravity, then the walls; the kinds and frictions are of (sides, floor)."""
    i, j, k = wp.tid()
    node = grid[i, j, k]
    mass = node[3]
    if mass > Real(0.0):
        v = Vector(node[0], node[1], node[2]) / mass + velocity_change
        if i <= padding:
            v = wall(v, 0, Real(1.0), wall_kinds[0], wall_frictions[0])
        if i >= high[0]:
            v = wall(v, 0, Real(-1.0), wall_kinds[0], wall_frictions[0])
        if j <= padding:
            v = wall(v, 1, Real(1.0), wall_kinds[0], wall_frictions[0])
        if j >= high[1]:
            v = wall(v, 1, Real(-1.0), wall_kinds[0], wall_frictions[0])
        if k <= padding:
            v = wall(v, 2, Real(1.0), wall_kinds[1], wall_frictions[1])
        grid[i, j, k] = Vector4(v[0], v[1], v[2], mass)


@wp.kernel
def grid_to_particles(
    grid: wp.array(dtype=Vector4),
    stride: wp.vec2i,
    positions: wp.array(dtype=Vector),
    residuals: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volume_corrections: wp.array(dtype=Real),
    deformation_gradients: wp.array(dtype=Matrix),
    held: wp.array(dtype=wp.int32),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
    time_step: Real,
    spacing: Real,
    shear_modulus: Real,
    lame_lambda: Real,
    cone_slope: Real,
    last_position: Vector,
    sweeps: int,
):
    """Gather velocity and its gradient, move the particle, strain it, and prepare its next scatter."""
    particle = wp.tid()
    position = positions[particle]
    i = int(position[0] - Real(0.5))
    j = int(position[1] - Real(0.5))
    k = int(position[2] - Real(0.5))
    x_arms = arms(position[0] - Real(i))
    y_arms = arms(position[1] - Real(j))
    z_arms = arms(position[2] - Real(k))
    x_weights = spline(x_arms)
    y_weights = spline(y_arms)
    z_weights = spline(z_arms)
    velocity = Vector()
    x_moment = Vector()
    y_moment = Vector()
    z_moment = Vector()
    for a in range(3):
        for b in range(3):
            weight = x_weights[a] * y_weights[b]
            node = (i + a) * stride[0] + (j + b) * stride[1] + k
            row = Vector()
            for c in range(3):
                entry = grid[node + c]
                share = weight * z_weights[c] * Vector(entry[0], entry[1], entry[2])
                row += share
                z_moment += z_arms[c] * share
            velocity += row
            x_moment += x_arms[a] * row
            y_moment += y_arms[b] * row
    moment = wp.matrix_from_cols(x_moment, y_moment, z_moment)

    # C = 4 / spacing * moment (Jiang et al. 2015: D = spacing^2 / 4 for quadratic splines)
    change = time_step * Real(4.0) / spacing * moment
    deformation_gradients[particle] += change * deformation_gradients[particle]
    x = unpack(elastic_states[particle])
    # b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
    half = change + change * x
    trial = x + half + wp.transpose(half) + half * wp.transpose(change)
    state, hencky, correction = return_mapping(trial, volume_corrections[particle], cone_slope, sweeps)
    stress = Real(2.0) * shear_modulus * hencky
    pressure = lame_lambda * wp.trace(hencky)
    stress += wp.diag(Vector(pressure, pressure, pressure))
    affines[particle] = (
        Real(4.0) * masses[particle] * moment - Real(4.0) * volumes[particle] * time_step / spacing * stress
    )
    elastic_states[particle] = pack(state)
    volume_corrections[particle] = correction
    velocities[particle] = velocity
    residual = residuals[particle]
    for axis in range(3):
        # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
        step = time_step / spacing * velocity[axis] + residual[axis]
        moved = position[axis] + step
        residual[axis] = step - (moved - position[axis])
        # written so that NaN, too, is held: an index made of it would leave the grid
        if not (moved >= Real(1.0)):
            moved = Real(1.0)
            residual[axis] = Real(0.0)
            held[particle] = 1
        if moved > last_position[axis]:
            moved = last_position[axis]
            residual[axis] = Real(0.0)
            held[particle] = 1
        position[axis] = moved
    positions[particle] = position
    residuals[particle] = residual


@wp.kernel
def bound_stretch(deformation_gradients: wp.array(dtype=Matrix), low: Real, high: Real, sweeps: int):
    """Hold the principal stretches of the rendering frames between two bounds: F <- F V diag(s' / s) V^T."""
    particle = wp.tid()
    gradient = deformation_gradients[particle]
    squared, vectors = symmetric_eigen(wp.transpose(gradient) * gradient, sweeps)
    ratio = Vector()
    changed = 0
    for axis in range(3):
        stretch = wp.sqrt(wp.max(squared[axis], SMALLEST_SQUARED_STRETCH))
        ratio[axis] = wp.clamp(stretch, low, high) / stretch
        if ratio[axis] != Real(1.0):
            changed = 1
    if changed == 1:
        deformation_gradients[particle] = gradient * with_eigenvalues(ratio, vectors)
