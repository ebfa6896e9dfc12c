"""A plain MLS-MPM in Warp: float32, SVD, atomics."""

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def weights(offset: float) -> wp.vec3:
    return wp.vec3(
        0.5 * (1.5 - offset) * (1.5 - offset),
        0.75 - (offset - 1.0) * (offset - 1.0),
        0.5 * (offset - 0.5) * (offset - 0.5),
    )


@wp.func
def project(gradient: wp.mat33, slope: float, mu: float, lam: float):
    """Return the elastic gradient on or inside Klar's cone, and the Kirchhoff stress."""
    u = wp.mat33()
    v = wp.mat33()
    s = wp.vec3()
    wp.svd3(gradient, u, s, v)
    strain = wp.vec3(wp.log(wp.max(s[0], 1e-6)), wp.log(wp.max(s[1], 1e-6)), wp.log(wp.max(s[2], 1e-6)))
    trace = strain[0] + strain[1] + strain[2]
    elastic = gradient
    if trace >= 0.0:
        strain = wp.vec3()
        elastic = u * wp.transpose(v)
    else:
        mean = trace / 3.0
        deviator = strain - wp.vec3(mean, mean, mean)
        norm = wp.length(deviator)
        excess = norm + slope * trace
        if excess > 0.0:
            strain = strain - deviator * (excess / norm)
            elastic = u * wp.diag(wp.vec3(wp.exp(strain[0]), wp.exp(strain[1]), wp.exp(strain[2]))) * wp.transpose(v)
    pressure = lam * (strain[0] + strain[1] + strain[2])
    principal = 2.0 * mu * strain + wp.vec3(pressure, pressure, pressure)
    return elastic, u * wp.diag(principal) * wp.transpose(u)


@wp.kernel
def compute_stress(
    trial: wp.array(dtype=wp.mat33),
    elastic: wp.array(dtype=wp.mat33),
    stress: wp.array(dtype=wp.mat33),
    slope: float,
    mu: float,
    lam: float,
):
    p = wp.tid()
    projected, kirchhoff = project(trial[p], slope, mu, lam)
    elastic[p] = projected
    stress[p] = kirchhoff


@wp.kernel
def scatter(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    c: wp.array(dtype=wp.mat33),
    stress: wp.array(dtype=wp.mat33),
    mass: wp.array(dtype=float),
    volume: wp.array(dtype=float),
    origin: wp.vec3,
    dx: float,
    dt: float,
    grid_v: wp.array3d(dtype=wp.vec3),
    grid_m: wp.array3d(dtype=float),
):
    p = wp.tid()
    place = (x[p] - origin) / dx
    i = int(place[0] - 0.5)
    j = int(place[1] - 0.5)
    k = int(place[2] - 0.5)
    offset = place - wp.vec3(float(i), float(j), float(k))
    wx = weights(offset[0])
    wy = weights(offset[1])
    wz = weights(offset[2])
    affine = mass[p] * c[p] - stress[p] * (4.0 * dt * volume[p] / (dx * dx))
    for a in range(3):
        for b in range(3):
            for d in range(3):
                arm = (wp.vec3(float(a), float(b), float(d)) - offset) * dx
                weight = wx[a] * wy[b] * wz[d]
                wp.atomic_add(grid_v, i + a, j + b, k + d, weight * (mass[p] * v[p] + affine * arm))
                wp.atomic_add(grid_m, i + a, j + b, k + d, weight * mass[p])


@wp.kernel
def update_grid(
    grid_v: wp.array3d(dtype=wp.vec3),
    grid_m: wp.array3d(dtype=float),
    change: wp.vec3,
    padding: int,
    high: wp.vec2i,
    friction: float,
):
    i, j, k = wp.tid()
    m = grid_m[i, j, k]
    if m > 0.0:
        v = grid_v[i, j, k] / m + change
        if i <= padding:
            v = wp.vec3(wp.max(v[0], 0.0), v[1], v[2])
        if i >= high[0]:
            v = wp.vec3(wp.min(v[0], 0.0), v[1], v[2])
        if j <= padding:
            v = wp.vec3(v[0], wp.max(v[1], 0.0), v[2])
        if j >= high[1]:
            v = wp.vec3(v[0], wp.min(v[1], 0.0), v[2])
        if k <= padding and v[2] < 0.0:
            along = wp.vec3(v[0], v[1], 0.0)
            speed = wp.length(along)
            v = along * wp.max(0.0, 1.0 + friction * v[2] / wp.max(speed, 1e-12))
        grid_v[i, j, k] = v


@wp.kernel
def gather(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    c: wp.array(dtype=wp.mat33),
    elastic: wp.array(dtype=wp.mat33),
    trial: wp.array(dtype=wp.mat33),
    total: wp.array(dtype=wp.mat33),
    origin: wp.vec3,
    dx: float,
    dt: float,
    grid_v: wp.array3d(dtype=wp.vec3),
):
    p = wp.tid()
    place = (x[p] - origin) / dx
    i = int(place[0] - 0.5)
    j = int(place[1] - 0.5)
    k = int(place[2] - 0.5)
    offset = place - wp.vec3(float(i), float(j), float(k))
    wx = weights(offset[0])
    wy = weights(offset[1])
    wz = weights(offset[2])
    velocity = wp.vec3()
    gradient = wp.mat33()
    for a in range(3):
        for b in range(3):
            for d in range(3):
                arm = wp.vec3(float(a), float(b), float(d)) - offset
                share = wx[a] * wy[b] * wz[d] * grid_v[i + a, j + b, k + d]
                velocity += share
                gradient += wp.outer(share, arm) * (4.0 / dx)
    v[p] = velocity
    c[p] = gradient
    x[p] = x[p] + dt * velocity
    step = wp.identity(3, dtype=float) + gradient * dt
    trial[p] = step * elastic[p]
    total[p] = step * total[p]


class Plain:
    """Steps a filling; `step(count)` carries out so many substeps."""

    def __init__(self, filling, problem, grid, slope):
        soil = problem.material
        count = len(filling.particle_positions)
        identity = np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
        zeros = np.zeros((count, 3, 3), np.float32)
        self.dt, _ = problem.time_step(grid)
        self.shape, self.count = grid.shape, count
        self.x = wp.array(filling.particle_positions, dtype=wp.vec3)
        self.v = wp.zeros(count, dtype=wp.vec3)
        self.c, self.stress = (wp.array(zeros, dtype=wp.mat33) for _ in range(2))
        self.elastic, self.trial, self.total = (wp.array(identity, dtype=wp.mat33) for _ in range(3))
        self.volume = wp.array(filling.particle_volumes, dtype=float)
        self.mass = wp.array(filling.particle_volumes * np.float32(soil.density), dtype=float)
        self.grid_v = wp.zeros(grid.shape, dtype=wp.vec3)
        self.grid_m = wp.zeros(grid.shape, dtype=float)
        nodes = (self.grid_v, self.grid_m)
        where = (wp.vec3(*grid.origin), grid.spacing, self.dt)
        gravity = wp.vec3(*(self.dt * component for component in problem.simulation.gravity))
        friction = float(np.tan(np.radians(problem.boundary.floor.friction_angle)))
        moduli = (soil.shear_modulus, soil.lame_lambda)
        self.launches = [
            (compute_stress, count, [self.trial, self.elastic, self.stress, slope, *moduli]),
            (scatter, count, [self.x, self.v, self.c, self.stress, self.mass, self.volume, *where, *nodes]),
            (update_grid, grid.shape, [*nodes, gravity, grid.padding, wp.vec2i(*grid.high), friction]),
            (gather, count, [self.x, self.v, self.c, self.elastic, self.trial, self.total, *where, self.grid_v]),
        ]  # fmt: skip

    def step(self, count):
        for _ in range(count):
            self.grid_v.zero_()
            self.grid_m.zero_()
            for kernel, dim, inputs in self.launches:
                wp.launch(kernel, dim=dim, inputs=inputs)

    def positions(self):
        return self.x.numpy().copy()
