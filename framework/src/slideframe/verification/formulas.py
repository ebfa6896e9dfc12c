"""Closed-form solutions that geotechnical engineers check solvers by. SI units, angles in degrees."""

import math


def column_settlement(density: float, gravity: float, height: float, constrained_modulus: float) -> float:
    """Settlement of the top of a laterally confined elastic column under its own weight, rho g H^2 / 2M, m."""
    return density * gravity * height**2 / (2 * constrained_modulus)


def earth_pressure_at_rest(poisson_ratio: float) -> float:
    """Ratio of horizontal to vertical stress in a laterally confined elastic body, K0 = nu / (1 - nu)."""
    return poisson_ratio / (1 - poisson_ratio)


def fundamental_period(height: float, wave_speed: float) -> float:
    """Period of a column that stands on a rigid floor, T1 = 4 H / c, s."""
    return 4 * height / wave_speed


def incline_acceleration(angle: float, friction: float, gravity: float = 9.81) -> float:
    """Acceleration of a block down an incline, g (sin theta - mu cos theta), or 0 where it sticks, m/s2 (Coulomb)."""
    tilt = math.radians(angle)
    return max(0.0, gravity * (math.sin(tilt) - friction * math.cos(tilt)))


def critical_slope(friction_angle: float) -> float:
    """Steepest angle at which a cohesionless infinite slope holds without dilatancy, atan(sin phi), degrees.

    In plane strain without volume change the sliding plane carries tau = sigma_n sin phi, not sigma_n tan phi
    (Davis 1968, "Theories of plasticity and the failure of soil masses").
    """
    return math.degrees(math.atan(math.sin(math.radians(friction_angle))))


def infinite_slope_safety(
    *,
    cohesion: float,
    friction_angle: float,
    unit_weight: float,
    depth: float,
    slope: float,
    pore_pressure: float = 0.0,
) -> float:
    """Factor of safety of an infinite slope with a sliding plane parallel to the surface.

    FoS = (c + (gamma z cos^2 beta - u) tan phi) / (gamma z sin beta cos beta)
    (Skempton and DeLory 1957, "Stability of natural slopes in London clay").

    Args:
        cohesion: Pa.
        friction_angle: degrees.
        unit_weight: N/m3.
        depth: vertical depth of the sliding plane, m.
        slope: degrees.
        pore_pressure: on the sliding plane, Pa.
    """
    beta, phi = math.radians(slope), math.radians(friction_angle)
    normal = unit_weight * depth * math.cos(beta) ** 2 - pore_pressure
    return (cohesion + normal * math.tan(phi)) / (unit_weight * depth * math.sin(beta) * math.cos(beta))


def triaxial_strength(cohesion: float, friction_angle: float, confinement: float) -> float:
    """Deviatoric stress sigma_1 - sigma_3 at failure in triaxial compression by Mohr-Coulomb, unit of the arguments."""
    sine, cosine = math.sin(math.radians(friction_angle)), math.cos(math.radians(friction_angle))
    return 2 * (cohesion * cosine + confinement * sine) / (1 - sine)


def extension_strength(cohesion: float, friction_angle: float, lateral: float) -> float:
    """Axial stress at failure in triaxial extension under a lateral stress, by Mohr-Coulomb, unit of the arguments."""
    sine, cosine = math.sin(math.radians(friction_angle)), math.cos(math.radians(friction_angle))
    return (lateral * (1 - sine) - 2 * cohesion * cosine) / (1 + sine)


def column_run_out(aspect_ratio: float) -> float:
    """Normalised run-out (L - L0) / L0 of a plane column of height aspect_ratio times width L0.

    1.2 a below a = 1.8 and 1.9 a^(2/3) above 2.8 (Lube et al. 2005, "Collapses of two-dimensional granular
    columns"); between the branches, their straight connection.
    """
    if aspect_ratio <= 1.8:
        return 1.2 * aspect_ratio
    if aspect_ratio >= 2.8:
        return float(1.9 * aspect_ratio ** (2 / 3))
    low, high = 1.2 * 1.8, 1.9 * 2.8 ** (2 / 3)
    return float(low + (high - low) * (aspect_ratio - 1.8))
