"""A plain MLS-MPM in Taichi: float32 fields, ti.svd, atomics, as in its mpm3d example, with sand."""

import numpy as np
import taichi as ti


@ti.data_oriented
class Plain:
    """Steps a filling; `step(count)` carries out so many substeps. Taichi must have been initialised."""

    def __init__(self, filling, problem, grid, slope):
        soil = problem.material
        self.count = len(filling.particle_positions)
        self.dt, _ = problem.time_step(grid)
        self.dx, self.slope = grid.spacing, slope
        self.mu, self.lam = soil.shear_modulus, soil.lame_lambda
        self.origin = ti.Vector(list(grid.origin))
        self.gravity = ti.Vector(list(problem.simulation.gravity))
        self.padding, self.high = grid.padding, grid.high
        self.friction = float(np.tan(np.radians(problem.boundary.floor.friction_angle)))
        self.x, self.v = (ti.Vector.field(3, float, self.count) for _ in range(2))
        self.c, self.elastic, self.total = (ti.Matrix.field(3, 3, float, self.count) for _ in range(3))
        self.mass, self.volume = (ti.field(float, self.count) for _ in range(2))
        self.grid_v, self.grid_m = ti.Vector.field(3, float, grid.shape), ti.field(float, grid.shape)
        identity = np.tile(np.eye(3, dtype=np.float32), (self.count, 1, 1))
        self.x.from_numpy(filling.particle_positions)
        self.elastic.from_numpy(identity)
        self.total.from_numpy(identity)
        self.volume.from_numpy(filling.particle_volumes)
        self.mass.from_numpy(filling.particle_volumes * np.float32(soil.density))

    @ti.kernel
    def substep(self):
        for place in ti.grouped(self.grid_m):
            self.grid_v[place] = ti.Vector.zero(float, 3)
            self.grid_m[place] = 0.0
        for p in self.x:
            place = (self.x[p] - self.origin) / self.dx
            base = ti.cast(place - 0.5, int)
            offset = place - base
            w = [0.5 * (1.5 - offset) ** 2, 0.75 - (offset - 1.0) ** 2, 0.5 * (offset - 0.5) ** 2]
            u, s, v = ti.svd(self.elastic[p])
            strain = ti.Vector([ti.log(ti.max(s[d, d], 1e-6)) for d in range(3)])
            trace = strain.sum()
            if trace >= 0.0:
                strain = ti.Vector.zero(float, 3)
                self.elastic[p] = u @ v.transpose()
            else:
                deviator = strain - trace / 3.0
                norm = deviator.norm()
                excess = norm + self.slope * trace
                if excess > 0.0:
                    strain -= deviator * (excess / norm)
                    stretch = ti.Matrix.zero(float, 3, 3)
                    for d in ti.static(range(3)):
                        stretch[d, d] = ti.exp(strain[d])
                    self.elastic[p] = u @ stretch @ v.transpose()
            principal = ti.Matrix.zero(float, 3, 3)
            for d in ti.static(range(3)):
                principal[d, d] = 2.0 * self.mu * strain[d] + self.lam * strain.sum()
            stress = u @ principal @ u.transpose()
            affine = self.mass[p] * self.c[p] - (4.0 * self.dt * self.volume[p] / self.dx**2) * stress
            for a, b, d in ti.static(ti.ndrange(3, 3, 3)):
                arm = (ti.Vector([a, b, d]) - offset) * self.dx
                weight = w[a][0] * w[b][1] * w[d][2]
                self.grid_v[base + ti.Vector([a, b, d])] += weight * (self.mass[p] * self.v[p] + affine @ arm)
                self.grid_m[base + ti.Vector([a, b, d])] += weight * self.mass[p]
        for i, j, k in self.grid_m:
            if self.grid_m[i, j, k] > 0.0:
                v = self.grid_v[i, j, k] / self.grid_m[i, j, k] + self.dt * self.gravity
                if i <= self.padding:
                    v[0] = ti.max(v[0], 0.0)
                if i >= self.high[0]:
                    v[0] = ti.min(v[0], 0.0)
                if j <= self.padding:
                    v[1] = ti.max(v[1], 0.0)
                if j >= self.high[1]:
                    v[1] = ti.min(v[1], 0.0)
                if k <= self.padding and v[2] < 0.0:
                    approach = -v[2]
                    v[2] = 0.0
                    v *= ti.max(0.0, 1.0 - self.friction * approach / ti.max(v.norm(), 1e-12))
                self.grid_v[i, j, k] = v
        for p in self.x:
            place = (self.x[p] - self.origin) / self.dx
            base = ti.cast(place - 0.5, int)
            offset = place - base
            w = [0.5 * (1.5 - offset) ** 2, 0.75 - (offset - 1.0) ** 2, 0.5 * (offset - 0.5) ** 2]
            velocity = ti.Vector.zero(float, 3)
            gradient = ti.Matrix.zero(float, 3, 3)
            for a, b, d in ti.static(ti.ndrange(3, 3, 3)):
                arm = ti.Vector([a, b, d]) - offset
                share = w[a][0] * w[b][1] * w[d][2] * self.grid_v[base + ti.Vector([a, b, d])]
                velocity += share
                gradient += share.outer_product(arm) * (4.0 / self.dx)
            self.v[p] = velocity
            self.c[p] = gradient
            self.x[p] += self.dt * velocity
            step = ti.Matrix.identity(float, 3) + self.dt * gradient
            self.elastic[p] = step @ self.elastic[p]
            self.total[p] = step @ self.total[p]

    def step(self, count):
        for _ in range(count):
            self.substep()
        ti.sync()

    def positions(self):
        return self.x.to_numpy()
