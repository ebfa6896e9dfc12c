"""The laws of the soil, particle by particle."""

import taichi as ti

from .tensors import double_dot, power_series, sphere, symmetric_eigen, with_eigenvalues

# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = 1e-12


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
