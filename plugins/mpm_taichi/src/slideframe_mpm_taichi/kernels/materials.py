"""The laws of the soil, particle by particle; docs/physics.md has their formulas.

Symmetric tensors are given by their six components (tensors.pack).
A law is one function: it is given the trial Hencky strain and answers whether that changes, the strain after plastic
flow, the volume correction that remains, and by how much the plastic deviatoric strain grew.
"""

import taichi as ti

from slideframe.problem.material import LAWS, LawConstants

from .tensors import pack, power_series, squared_norm, symmetric_eigen, trace_of, unpack, with_eigenvalues, with_sphere

# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = 1e-12

DRUCKER_PRAGER = LAWS.index("drucker_prager")
MOHR_COULOMB = LAWS.index("mohr_coulomb")

SHEAR_MODULUS = LawConstants._fields.index("shear_modulus")
LAME_LAMBDA = LawConstants._fields.index("lame_lambda")
CONE_SLOPE = LawConstants._fields.index("cone_slope")
DILATION = LawConstants._fields.index("dilation")
APEX = LawConstants._fields.index("apex")
CUTOFF = LawConstants._fields.index("cutoff")
KEEPS_EXPANSION = LawConstants._fields.index("keeps_expansion")
SINE_FRICTION = LawConstants._fields.index("sine_friction")
SINE_DILATANCY = LawConstants._fields.index("sine_dilatancy")
COHESION = LawConstants._fields.index("cohesion")


@ti.func
def hencky_strain(x, series_radius):
    """Return log(1 + X) / 2: by series within `series_radius`, by eigenvalues beyond."""
    result = x
    if squared_norm(x) <= series_radius * series_radius:
        result = power_series(x, (1 / 2, -1 / 4, 1 / 6, -1 / 8, 1 / 10, -1 / 12))
    else:
        values, vectors = symmetric_eigen(unpack(x))
        result = pack(with_eigenvalues(0.5 * ti.log(ti.max(1.0 + values, SMALLEST_SQUARED_STRETCH)), vectors))
    return result


@ti.func
def state_of(hencky, series_radius):
    """Return X = exp(2 h) - 1: by series within `series_radius`, by eigenvalues beyond."""
    y = 2.0 * hencky
    result = y
    if squared_norm(y) <= series_radius * series_radius:
        result = power_series(y, (1.0, 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720))
    else:
        values, vectors = symmetric_eigen(unpack(y))
        result = pack(with_eigenvalues(ti.exp(values) - 1.0, vectors))
    return result


@ti.func
def kirchhoff_stress(hencky, soil):
    """Return tau = 2 mu h + lambda tr(h) 1, Pa."""
    return with_sphere(2.0 * soil[SHEAR_MODULUS] * hencky, soil[LAME_LAMBDA] * trace_of(hencky))


@ti.func
def drucker_prager(trial, correction, soil):
    """Return to the cone |dev h| + slope (tr h - apex) = 0, or to the tension cut-off where it is beyond that.

    The deviator's direction stays, so trace and norm decide all and no eigenvectors are needed.
    """
    trace = trace_of(trial)
    deviator = with_sphere(trial, -trace / 3.0)
    norm = ti.sqrt(squared_norm(deviator))
    # compression closes what once opened, before it meets resistance
    used = ti.min(ti.max(-trace, 0.0), correction)
    trace += used
    remaining = correction - used
    changed = used > 0.0
    left = norm
    excess = norm + soil[CONE_SLOPE] * (trace - soil[APEX])
    if excess > 0.0 or trace > soil[CUTOFF]:
        changed = True
        flow = ti.max(excess, 0.0) / (1.0 + soil[CONE_SLOPE] * soil[DILATION])
        left = norm - flow
        dilated = trace - soil[DILATION] * flow
        if dilated > soil[CUTOFF]:
            left = ti.min(norm, soil[CONE_SLOPE] * (soil[APEX] - soil[CUTOFF]))
            dilated = soil[CUTOFF]
            remaining += soil[KEEPS_EXPANSION] * (trace - soil[CUTOFF])
        trace = dilated
    hencky = trial
    if changed:
        kept = 1.0
        if left < norm:
            kept = left / norm
        hencky = with_sphere(kept * deviator, trace / 3.0)
    return changed, hencky, remaining, norm - left


@ti.func
def swap_if_less(values: ti.template(), vectors: ti.template(), first: ti.template(), second: ti.template()):
    """Put the larger of two eigenvalues first, with its eigenvector."""
    if values[first] < values[second]:
        larger = values[second]
        values[second] = values[first]
        values[first] = larger
        for axis in ti.static(range(3)):
            component = vectors[axis, second]
            vectors[axis, second] = vectors[axis, first]
            vectors[axis, first] = component


@ti.func
def cut_tension(trial, ratio, limit):
    """Return principal strains whose stresses, in 2 mu, are at most `limit` (Rankine, associated); `trial` descends."""
    over = trial + ratio * trial.sum() - limit
    strain = trial
    if over[0] > 0.0:
        first = over[0] / (1.0 + ratio)
        second = 0.0
        if over[1] - ratio * first > 0.0:
            first = ((1.0 + ratio) * over[0] - ratio * over[1]) / (1.0 + 2.0 * ratio)
            second = ((1.0 + ratio) * over[1] - ratio * over[0]) / (1.0 + 2.0 * ratio)
        strain = trial - ti.Vector([first, second, 0.0])
        if over[2] - ratio * (first + second) > 0.0:
            equal = limit / (1.0 + 3.0 * ratio)
            strain = ti.Vector([equal, equal, equal])
    return strain


@ti.func
def to_pyramid(trial, ratio, soil):
    """Return principal strains on Mohr-Coulomb's pyramid: plane, edge or apex (de Souza Neto et al. 2008, sect. 8.2).

    `trial` descends; stresses are in 2 mu, so that s = e + ratio tr(e) with ratio = lambda / (2 mu).
    """
    sine = soil[SINE_FRICTION]
    widening = 1.0 + soil[SINE_DILATANCY]
    narrowing = 1.0 - soil[SINE_DILATANCY]
    s = trial + ratio * trial.sum()
    over = s[0] - s[2] + (s[0] + s[2]) * sine - soil[COHESION]
    strain = trial
    if over > 0.0:
        shared = 4.0 * ratio * sine * soil[SINE_DILATANCY]
        own = 2.0 + 2.0 * sine * soil[SINE_DILATANCY] + shared
        flow = over / own
        strain = trial + flow * ti.Vector([-widening, 0.0, narrowing])
        if strain[0] < strain[1] or strain[1] < strain[2]:
            if narrowing * s[0] - 2.0 * s[1] + widening * s[2] > 0.0:
                # the lower two become equal
                both = (1.0 + sine) * widening + shared
                other = s[0] - s[1] + (s[0] + s[1]) * sine - soil[COHESION]
                flow = (own * over - both * other) / (own * own - both * both)
                second = (own * other - both * over) / (own * own - both * both)
                strain = trial + ti.Vector([-(flow + second) * widening, second * narrowing, flow * narrowing])
            else:
                # the upper two become equal
                both = (1.0 - sine) * narrowing + shared
                other = s[1] - s[2] + (s[1] + s[2]) * sine - soil[COHESION]
                flow = (own * over - both * other) / (own * own - both * both)
                second = (own * other - both * over) / (own * own - both * both)
                strain = trial + ti.Vector([-flow * widening, -second * widening, (flow + second) * narrowing])
            if strain[0] <= strain[2]:
                apex = soil[APEX] / 3.0
                strain = ti.Vector([apex, apex, apex])
    return strain


@ti.func
def mohr_coulomb(trial, correction, soil):
    """Return to Mohr-Coulomb's pyramid in principal strains, after the tension cut-off."""
    trace = trace_of(trial)
    deviator = with_sphere(trial, -trace / 3.0)
    norm = ti.sqrt(squared_norm(deviator))
    ratio = soil[LAME_LAMBDA] / (2.0 * soil[SHEAR_MODULUS])
    used = ti.min(ti.max(-trace, 0.0), correction)
    remaining = correction - used
    changed = used > 0.0
    hencky = trial
    sheared = 0.0
    # within the inscribed cone, and with no stress that can reach the cut-off, no eigenvectors are needed
    inside = norm + soil[CONE_SLOPE] * (trace + used - soil[APEX]) <= 0.0
    largest = (1.0 / 3.0 + ratio) * (trace + used) + norm
    if changed or not inside or largest > soil[CUTOFF]:
        values, vectors = symmetric_eigen(unpack(trial))
        swap_if_less(values, vectors, 0, 1)
        swap_if_less(values, vectors, 1, 2)
        swap_if_less(values, vectors, 0, 1)
        values += used / 3.0
        cut = cut_tension(values, ratio, soil[CUTOFF])
        strain = to_pyramid(cut, ratio, soil)
        moved = values - strain
        if changed or moved.norm_sqr() > 0.0:
            changed = True
            opened = values.sum() - cut.sum()
            volume = moved.sum()
            if strain[0] == strain[2]:
                opened = ti.max(volume, 0.0)
            remaining += soil[KEEPS_EXPANSION] * opened
            sheared = (moved - volume / 3.0).norm()
            hencky = pack(with_eigenvalues(strain, vectors))
    return changed, hencky, remaining, sheared


@ti.func
def return_mapping(law: ti.template(), trial, correction, soil, series_radius):
    """Return X, the Hencky strain, the volume correction and the growth of plastic deviatoric strain, after flow.

    A state that the law doesn't change is returned untouched.
    """
    hencky = hencky_strain(trial, series_radius)
    state = trial
    remaining = correction
    sheared = 0.0
    changed = False
    if ti.static(law == DRUCKER_PRAGER):
        changed, hencky, remaining, sheared = drucker_prager(hencky, correction, soil)
    elif ti.static(law == MOHR_COULOMB):
        changed, hencky, remaining, sheared = mohr_coulomb(hencky, correction, soil)
    if changed:
        state = state_of(hencky, series_radius)
    return state, hencky, remaining, sheared
