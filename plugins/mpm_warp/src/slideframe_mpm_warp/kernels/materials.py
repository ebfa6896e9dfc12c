"""The laws of the soil, particle by particle."""

import warp as wp

from .reals import Matrix, Real, Vector
from .tensors import power_series, symmetric_eigen, with_eigenvalues

wp.set_module_options({"enable_backward": False})

# The series for log(1 + X) and exp(Y) - 1 end with the sixth power. Within this norm the first neglected
# term, of relative size norm^6 / 7, is below the rounding of the type.
SERIES_RADIUS = wp.constant(Real(0.08 if Real == wp.float32 else 0.003))
# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = wp.constant(Real(1e-12))


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
