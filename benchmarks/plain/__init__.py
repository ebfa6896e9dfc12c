"""What the solvers are measured against: the Material Point Method as it is usually written in Warp and in Taichi.

Layout and steps are those of the solvers that came with PhysGaussian (Warp) and of Taichi's mpm3d example with sand:
the elastic deformation gradient, an SVD in every step, particles never sorted, a dense grid, atomic sums. Cone, walls
and the renderer's total deformation gradient are the measured solvers' own, so that both do the same work; only the
memory of expansion is left out. The benchmark shows first that they move alike.
"""
