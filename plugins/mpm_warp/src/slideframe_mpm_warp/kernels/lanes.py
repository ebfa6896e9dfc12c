"""Drucker-Prager's law for as many particles at once as the processor's widest vectors have lanes.

It is `materials.drucker_prager` between the two series of `materials`, on components of symmetric tensors; a particle
beyond the series, which needs eigenvalues, is left to that. Half the time of a substep goes into the law
(benchmarks/mpm.py), and Warp's compiler finds nothing to vectorise across particles by itself.
"""

import warp as wp

from .materials import (
    APEX,
    CONE_SLOPE,
    CUTOFF,
    DILATION,
    KEEPS_EXPANSION,
    LAME_LAMBDA,
    SERIES_RADIUS,
    SHEAR_MODULUS,
    Soil,
)
from .reals import LANES, Matrix, Real, Vector6

wp.set_module_options({"enable_backward": False})

_REAL = "float" if Real == wp.float32 else "double"
_TYPES = f"""
    typedef {_REAL} Real;
    typedef Real Lane __attribute__((ext_vector_type({LANES})));
    struct Symmetric {{ Lane xx, yy, zz, yz, xz, xy; }};
"""
# c1 A + c2 A^2 + ... + c6 A^6, as `tensors.power_series`
_SERIES = """
    auto power_series = [](const Symmetric& a, const Real c[6]) {
        const Lane xx = a.xx * a.xx + a.xy * a.xy + a.xz * a.xz;
        const Lane yy = a.xy * a.xy + a.yy * a.yy + a.yz * a.yz;
        const Lane zz = a.xz * a.xz + a.yz * a.yz + a.zz * a.zz;
        const Lane yz = a.xy * a.xz + a.yy * a.yz + a.yz * a.zz;
        const Lane xz = a.xx * a.xz + a.xy * a.yz + a.xz * a.zz;
        const Lane xy = a.xx * a.xy + a.xy * a.yy + a.xz * a.yz;
        const Lane first = a.xx + a.yy + a.zz;
        const Lane second = (Real)0.5 * (first * first - (xx + yy + zz));
        const Lane third = a.xx * (a.yy * a.zz - a.yz * a.yz) - a.xy * (a.xy * a.zz - a.yz * a.xz)
            + a.xz * (a.xy * a.yz - a.yy * a.xz);
        Lane p0 = c[5], p1 = 0, p2 = 0;
        for (int power = 4; power >= -1; --power) {
            const Lane low = p2 * third + (power >= 0 ? c[power] : (Real)0);
            const Lane middle = p0 - p2 * second;
            p2 = p1 + p2 * first;
            p0 = low;
            p1 = middle;
        }
        return Symmetric{p0 + p1 * a.xx + p2 * xx, p0 + p1 * a.yy + p2 * yy, p0 + p1 * a.zz + p2 * zz,
            p1 * a.yz + p2 * yz, p1 * a.xz + p2 * xz, p1 * a.xy + p2 * xy};
    };
    auto squared = [](const Symmetric& a) {
        return a.xx * a.xx + a.yy * a.yy + a.zz * a.zz + (Real)2 * (a.yz * a.yz + a.xz * a.xz + a.xy * a.xy);
    };
"""
_LAW = f"""
    const Real slope = soil[{int(CONE_SLOPE)}], dilation = soil[{int(DILATION)}], apex = soil[{int(APEX)}];
    const Real cutoff = soil[{int(CUTOFF)}], keeps = soil[{int(KEEPS_EXPANSION)}];
    const Real shear = soil[{int(SHEAR_MODULUS)}], lame = soil[{int(LAME_LAMBDA)}];
    const Real radius = (Real){float(SERIES_RADIUS)!r} * (Real){float(SERIES_RADIUS)!r};
"""


@wp.func_native(
    _TYPES
    + _SERIES
    + _LAW
    + """
    const Real logarithm[6] = {1.0 / 2, -1.0 / 4, 1.0 / 6, -1.0 / 8, 1.0 / 10, -1.0 / 12};
    const Real exponential[6] = {1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720};
    const Real* moment = (const Real*)affines.data + 9 * first;
    Real* states = (Real*)elastic_states.data + 6 * first;
    Real* corrections = (Real*)volume_corrections.data + first;
    const Real* weight = (const Real*)masses.data + first;
    constexpr int lanes = sizeof(Lane) / sizeof(Real);

    // by component, then lane: written one by one, read as vectors
    alignas(sizeof(Lane)) Real gathered[18][lanes];
    for (int lane = 0; lane < lanes; ++lane) {
        const int p = lane < count ? lane : count - 1;
        for (int entry = 0; entry < 9; ++entry)
            gathered[entry][lane] = moment[9 * p + entry];
        for (int entry = 0; entry < 6; ++entry)
            gathered[9 + entry][lane] = states[6 * p + entry];
        gathered[15][lane] = corrections[p];
        gathered[16][lane] = weight[p];
        gathered[17][lane] = ((const Real*)volumes.data)[first + p];
    }
    const Lane* in = (const Lane*)gathered;
    const Symmetric x = {in[9], in[10], in[11], in[12], in[13], in[14]};
    const Lane correction = in[15], mass = in[16], volume = in[17];
    Lane g[9];
    for (int entry = 0; entry < 9; ++entry)
        g[entry] = scale * in[entry];

    // b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
    Lane half[9];
    for (int row = 0; row < 3; ++row) {
        const Lane a = g[3 * row], b = g[3 * row + 1], c = g[3 * row + 2];
        half[3 * row] = a + (a * x.xx + b * x.xy + c * x.xz);
        half[3 * row + 1] = b + (a * x.xy + b * x.yy + c * x.yz);
        half[3 * row + 2] = c + (a * x.xz + b * x.yz + c * x.zz);
    }
    auto both = [&](int i, int j) {
        return half[3 * i + j] + half[3 * j + i]
            + (half[3 * i] * g[3 * j] + half[3 * i + 1] * g[3 * j + 1] + half[3 * i + 2] * g[3 * j + 2]);
    };
    const Symmetric trial = {x.xx + both(0, 0), x.yy + both(1, 1), x.zz + both(2, 2),
        x.yz + both(1, 2), x.xz + both(0, 2), x.xy + both(0, 1)};
    Symmetric h = power_series(trial, logarithm);
    auto beyond = !(squared(trial) <= radius);

    Lane trace = h.xx + h.yy + h.zz;
    const Lane mean = trace / (Real)3;
    Symmetric d = {h.xx - mean, h.yy - mean, h.zz - mean, h.yz, h.xz, h.xy};
    const Lane norm = __builtin_elementwise_sqrt(squared(d));
    // compression closes what once opened, before it meets resistance
    const Lane zero = 0;
    const Lane used = __builtin_elementwise_min(__builtin_elementwise_max(-trace, zero), correction);
    trace += used;
    Lane remaining = correction - used;
    const Lane excess = norm + slope * (trace - apex);
    const auto yields = (excess > zero) | (trace > cutoff);
    const Lane flow = __builtin_elementwise_max(excess, zero) / ((Real)1 + slope * dilation);
    const Lane dilated = trace - dilation * flow;
    const auto cut = dilated > cutoff;
    const Lane tip = slope * (apex - cutoff);
    Lane left = cut ? __builtin_elementwise_min(norm, tip) : norm - flow;
    left = yields ? left : norm;
    remaining = yields & cut ? remaining + keeps * (trace - cutoff) : remaining;
    const Lane cut_trace = cutoff;
    trace = yields ? (cut ? cut_trace : dilated) : trace;
    const auto changed = (used > zero) | yields;
    const Lane one = 1;
    const Lane kept = left < norm ? left / norm : one;
    const Lane third = trace / (Real)3;
    h.xx = changed ? kept * d.xx + third : h.xx, h.yy = changed ? kept * d.yy + third : h.yy;
    h.zz = changed ? kept * d.zz + third : h.zz, h.yz = changed ? kept * h.yz : h.yz;
    h.xz = changed ? kept * h.xz : h.xz, h.xy = changed ? kept * h.xy : h.xy;
    const Symmetric y = {h.xx + h.xx, h.yy + h.yy, h.zz + h.zz, h.yz + h.yz, h.xz + h.xz, h.xy + h.xy};
    beyond |= changed & !(squared(y) <= radius);
    const Symmetric s = power_series(y, exponential);

    // the stress term of the next scatter
    const Lane pull = (Real)-1 * scale * volume;
    const Lane pressure = lame * (h.xx + h.yy + h.zz);
    const Lane twice = (Real)2 * shear;
    const Symmetric p = {pull * (twice * h.xx + pressure), pull * (twice * h.yy + pressure),
        pull * (twice * h.zz + pressure), pull * twice * h.yz, pull * twice * h.xz, pull * twice * h.xy};
    const Lane share = affine_share * (Real)4 * mass;
    const Lane pulled[9] = {p.xx, p.xy, p.xz, p.xy, p.yy, p.yz, p.xz, p.yz, p.zz};
    const bool apart = pulls.data != affines.data;
    alignas(sizeof(Lane)) Real scattered[26][lanes];
    Lane* out = (Lane*)scattered;
    for (int entry = 0; entry < 9; ++entry) {
        out[entry] = share * in[entry] + (apart ? zero : pulled[entry]);
        out[9 + entry] = pulled[entry];
    }
    out[18] = changed ? s.xx : trial.xx, out[19] = changed ? s.yy : trial.yy, out[20] = changed ? s.zz : trial.zz;
    out[21] = changed ? s.yz : trial.yz, out[22] = changed ? s.xz : trial.xz, out[23] = changed ? s.xy : trial.xy;
    out[24] = remaining, out[25] = norm - left;
    int undone = 0;
    for (int lane = 0; lane < count; ++lane) {
        if (weight[lane] == (Real)0)
            continue;
        if (beyond[lane]) {
            undone |= 1 << lane;
            continue;
        }
        for (int entry = 0; entry < 9; ++entry)
            ((Real*)affines.data)[9 * (first + lane) + entry] = scattered[entry][lane];
        if (apart)
            for (int entry = 0; entry < 9; ++entry)
                ((Real*)pulls.data)[9 * (first + lane) + entry] = scattered[9 + entry][lane];
        for (int entry = 0; entry < 6; ++entry)
            states[6 * lane + entry] = scattered[18 + entry][lane];
        corrections[lane] = scattered[24][lane];
        if (plastic_strains.shape[0] > 0)
            ((Real*)plastic_strains.data)[first + lane] += scattered[25][lane];
    }
    return undone;
    """
)
def strain_lanes(
    first: int,
    count: int,
    scale: Real,
    affine_share: Real,
    soil: Soil,
    affines: wp.array(dtype=Matrix),
    pulls: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volume_corrections: wp.array(dtype=Real),
    plastic_strains: wp.array(dtype=Real),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
) -> int:
    """Strain `count` particles by `scale` times the moments in `affines`; return the bits of those left undone."""
    ...
