"""The laws of the soil, particle by particle; docs/physics.md has their formulas.

A law is one function: it is given the trial Hencky strain and answers whether that changes, the strain after plastic
flow, the volume correction that remains, and by how much the plastic deviatoric strain grew.
"""

import warp as wp

from slideframe.problem.material import LAWS, LawConstants

from .reals import Matrix, Real, Vector
from .tensors import power_series, symmetric_eigen, with_eigenvalues

wp.set_module_options({"enable_backward": False})

# The series for log(1 + X) and exp(Y) - 1 end with the sixth power. Within this norm the first neglected
# term, of relative size norm^6 / 7, is below the rounding of the type.
SERIES_RADIUS = wp.constant(Real(0.08 if Real == wp.float32 else 0.003))
# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = wp.constant(Real(1e-12))

Soil = wp.types.vector(len(LawConstants._fields), Real)

DRUCKER_PRAGER = wp.constant(LAWS.index("drucker_prager"))
MOHR_COULOMB = wp.constant(LAWS.index("mohr_coulomb"))

SHEAR_MODULUS = wp.constant(LawConstants._fields.index("shear_modulus"))
LAME_LAMBDA = wp.constant(LawConstants._fields.index("lame_lambda"))
CONE_SLOPE = wp.constant(LawConstants._fields.index("cone_slope"))
DILATION = wp.constant(LawConstants._fields.index("dilation"))
APEX = wp.constant(LawConstants._fields.index("apex"))
CUTOFF = wp.constant(LawConstants._fields.index("cutoff"))
KEEPS_EXPANSION = wp.constant(LawConstants._fields.index("keeps_expansion"))
SINE_FRICTION = wp.constant(LawConstants._fields.index("sine_friction"))
SINE_DILATANCY = wp.constant(LawConstants._fields.index("sine_dilatancy"))
COHESION = wp.constant(LawConstants._fields.index("cohesion"))


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
def kirchhoff_stress(hencky: Matrix, soil: Soil) -> Matrix:
    """Return tau = 2 mu h + lambda tr(h) 1, Pa."""
    pressure = soil[LAME_LAMBDA] * wp.trace(hencky)
    return Real(2.0) * soil[SHEAR_MODULUS] * hencky + wp.diag(Vector(pressure, pressure, pressure))


@wp.func
def drucker_prager(trial: Matrix, correction: Real, soil: Soil):
    """Return to the cone |dev h| + slope (tr h - apex) = 0, or to the tension cut-off where it is beyond that.

    The deviator's direction stays, so trace and norm decide all and no eigenvectors are needed.
    """
    trace = wp.trace(trial)
    mean = trace / Real(3.0)
    deviator = trial - wp.diag(Vector(mean, mean, mean))
    norm = wp.sqrt(wp.ddot(deviator, deviator))
    # compression closes what once opened, before it meets resistance
    used = wp.clamp(-trace, Real(0.0), correction)
    trace += used
    remaining = correction - used
    changed = used > Real(0.0)
    left = norm
    excess = norm + soil[CONE_SLOPE] * (trace - soil[APEX])
    if excess > Real(0.0) or trace > soil[CUTOFF]:
        changed = True
        flow = wp.max(excess, Real(0.0)) / (Real(1.0) + soil[CONE_SLOPE] * soil[DILATION])
        left = norm - flow
        dilated = trace - soil[DILATION] * flow
        if dilated > soil[CUTOFF]:
            left = wp.min(norm, soil[CONE_SLOPE] * (soil[APEX] - soil[CUTOFF]))
            dilated = soil[CUTOFF]
            remaining += soil[KEEPS_EXPANSION] * (trace - soil[CUTOFF])
        trace = dilated
    hencky = trial
    if changed:
        kept = Real(1.0)
        if left < norm:
            kept = left / norm
        mean = trace / Real(3.0)
        hencky = kept * deviator + wp.diag(Vector(mean, mean, mean))
    return changed, hencky, remaining, norm - left


@wp.func
def swap_if_less(a: Vector, v: Matrix, first: int, second: int):
    """Put the larger of two eigenvalues first, with its eigenvector."""
    values = a
    vectors = v
    if values[first] < values[second]:
        larger = values[second]
        values[second] = values[first]
        values[first] = larger
        for axis in range(3):
            component = vectors[axis, second]
            vectors[axis, second] = vectors[axis, first]
            vectors[axis, first] = component
    return values, vectors


@wp.func
def cut_tension(trial: Vector, ratio: Real, limit: Real) -> Vector:
    """Return principal strains whose stresses, in 2 mu, are at most `limit` (Rankine, associated); `trial` descends."""
    pressure = ratio * (trial[0] + trial[1] + trial[2])
    over_first = trial[0] + pressure - limit
    over_second = trial[1] + pressure - limit
    over_third = trial[2] + pressure - limit
    strain = trial
    if over_first > Real(0.0):
        first = over_first / (Real(1.0) + ratio)
        second = Real(0.0)
        if over_second - ratio * first > Real(0.0):
            first = ((Real(1.0) + ratio) * over_first - ratio * over_second) / (Real(1.0) + Real(2.0) * ratio)
            second = ((Real(1.0) + ratio) * over_second - ratio * over_first) / (Real(1.0) + Real(2.0) * ratio)
        strain = Vector(trial[0] - first, trial[1] - second, trial[2])
        if over_third - ratio * (first + second) > Real(0.0):
            equal = limit / (Real(1.0) + Real(3.0) * ratio)
            strain = Vector(equal, equal, equal)
    return strain


@wp.func
def to_pyramid(trial: Vector, ratio: Real, soil: Soil) -> Vector:
    """Return principal strains on Mohr-Coulomb's pyramid: plane, edge or apex (de Souza Neto et al. 2008, sect. 8.2).

    `trial` descends; stresses are in 2 mu, so that s = e + ratio tr(e) with ratio = lambda / (2 mu).
    """
    sine = soil[SINE_FRICTION]
    widening = Real(1.0) + soil[SINE_DILATANCY]
    narrowing = Real(1.0) - soil[SINE_DILATANCY]
    pressure = ratio * (trial[0] + trial[1] + trial[2])
    s = trial + Vector(pressure, pressure, pressure)
    over = s[0] - s[2] + (s[0] + s[2]) * sine - soil[COHESION]
    strain = trial
    if over > Real(0.0):
        shared = Real(4.0) * ratio * sine * soil[SINE_DILATANCY]
        own = Real(2.0) + Real(2.0) * sine * soil[SINE_DILATANCY] + shared
        flow = over / own
        strain = trial + flow * Vector(-widening, Real(0.0), narrowing)
        if strain[0] < strain[1] or strain[1] < strain[2]:
            if narrowing * s[0] - Real(2.0) * s[1] + widening * s[2] > Real(0.0):
                # the lower two become equal
                both = (Real(1.0) + sine) * widening + shared
                other = s[0] - s[1] + (s[0] + s[1]) * sine - soil[COHESION]
                flow = (own * over - both * other) / (own * own - both * both)
                second = (own * other - both * over) / (own * own - both * both)
                strain = trial + Vector(-(flow + second) * widening, second * narrowing, flow * narrowing)
            else:
                # the upper two become equal
                both = (Real(1.0) - sine) * narrowing + shared
                other = s[1] - s[2] + (s[1] + s[2]) * sine - soil[COHESION]
                flow = (own * over - both * other) / (own * own - both * both)
                second = (own * other - both * over) / (own * own - both * both)
                strain = trial + Vector(-flow * widening, -second * widening, (flow + second) * narrowing)
            if strain[0] <= strain[2]:
                apex = soil[APEX] / Real(3.0)
                strain = Vector(apex, apex, apex)
    return strain


@wp.func
def mohr_coulomb(trial: Matrix, correction: Real, soil: Soil, sweeps: int):
    """Return to Mohr-Coulomb's pyramid in principal strains, after the tension cut-off."""
    trace = wp.trace(trial)
    mean = trace / Real(3.0)
    deviator = trial - wp.diag(Vector(mean, mean, mean))
    norm = wp.sqrt(wp.ddot(deviator, deviator))
    ratio = soil[LAME_LAMBDA] / (Real(2.0) * soil[SHEAR_MODULUS])
    used = wp.clamp(-trace, Real(0.0), correction)
    remaining = correction - used
    changed = used > Real(0.0)
    hencky = trial
    sheared = Real(0.0)
    # within the inscribed cone, and with no stress that can reach the cut-off, no eigenvectors are needed
    inside = norm + soil[CONE_SLOPE] * (trace + used - soil[APEX]) <= Real(0.0)
    largest = (Real(1.0) / Real(3.0) + ratio) * (trace + used) + norm
    if changed or not inside or largest > soil[CUTOFF]:
        values, vectors = symmetric_eigen(trial, sweeps)
        values, vectors = swap_if_less(values, vectors, 0, 1)
        values, vectors = swap_if_less(values, vectors, 1, 2)
        values, vectors = swap_if_less(values, vectors, 0, 1)
        values += Vector(used, used, used) / Real(3.0)
        cut = cut_tension(values, ratio, soil[CUTOFF])
        strain = to_pyramid(cut, ratio, soil)
        moved = values - strain
        if changed or wp.dot(moved, moved) > Real(0.0):
            changed = True
            opened = values[0] + values[1] + values[2] - (cut[0] + cut[1] + cut[2])
            volume = moved[0] + moved[1] + moved[2]
            if strain[0] == strain[2]:
                opened = wp.max(volume, Real(0.0))
            remaining += soil[KEEPS_EXPANSION] * opened
            moved -= Vector(volume, volume, volume) / Real(3.0)
            sheared = wp.length(moved)
            hencky = with_eigenvalues(strain, vectors)
    return changed, hencky, remaining, sheared


@wp.func
def return_mapping(law: int, trial: Matrix, correction: Real, soil: Soil, sweeps: int):
    """Return X, the Hencky strain, the volume correction and the growth of plastic deviatoric strain, after flow.

    A state that the law doesn't change is returned untouched.
    """
    hencky = hencky_strain(trial, sweeps)
    state = trial
    remaining = correction
    sheared = Real(0.0)
    changed = False
    if law == DRUCKER_PRAGER:
        changed, hencky, remaining, sheared = drucker_prager(hencky, correction, soil)
    elif law == MOHR_COULOMB:
        changed, hencky, remaining, sheared = mohr_coulomb(hencky, correction, soil, sweeps)
    if changed:
        state = state_of(hencky, sweeps)
    return state, hencky, remaining, sheared
