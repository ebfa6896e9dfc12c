"""Binning and compositing of splats in Warp, for cards on which nothing can be compiled but what a driver compiles.

One thread is one pixel, which goes through its tile's splats near to far. The outline and the falloff of a splat are
those of `projection_kernels`. Gradients are summed with atomics, so their last bits change from run to run.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TILE = wp.constant(16)
LARGEST_ALPHA = wp.constant(0.99)
SMALLEST_ALPHA = wp.constant(1.0 / 255.0)
# a pixel is left alone, so there is none to average its error away with
OPAQUE_TRANSMITTANCE = wp.constant(1.0e-7)
MEDIAN_TRANSMITTANCE = wp.constant(0.5)


@wp.func
def first_tile(middle: float, extent: float, tiles: int):
    """Return the first tile that a splat's box touches along one axis."""
    return wp.clamp(int(wp.floor((middle - extent - 0.5) / float(TILE))), 0, tiles)


@wp.func
def last_tile(middle: float, extent: float, tiles: int):
    """Return one past the last tile that a splat's box touches along one axis."""
    return wp.clamp(int(wp.floor((middle + extent - 0.5) / float(TILE))) + 1, 0, tiles)


@wp.kernel
def count_tiles(
    means: wp.array(dtype=wp.vec2), extents: wp.array(dtype=wp.vec2), columns: int, rows: int,
    counts: wp.array(dtype=wp.int32),
):  # fmt: skip
    """Write how many tiles each splat's box touches; none where the extent is 0."""
    s = wp.tid()
    mean, extent = means[s], extents[s]
    count = wp.int32(0)
    if extent[0] > 0.0:
        wide = last_tile(mean[0], extent[0], columns) - first_tile(mean[0], extent[0], columns)
        high = last_tile(mean[1], extent[1], rows) - first_tile(mean[1], extent[1], rows)
        count = wp.max(wide, 0) * wp.max(high, 0)
    counts[s] = count


@wp.kernel
def list_tiles(
    means: wp.array(dtype=wp.vec2), extents: wp.array(dtype=wp.vec2), depth_ranks: wp.array(dtype=wp.int32),
    columns: int, rows: int, ends: wp.array(dtype=wp.int32), counts: wp.array(dtype=wp.int32),
    keys: wp.array(dtype=wp.int64), splats: wp.array(dtype=wp.int32),
):  # fmt: skip
    """Write each splat's tiles as keys that sort by tile, then by depth."""
    s = wp.tid()
    if counts[s] > 0:
        mean, extent = means[s], extents[s]
        entry = ends[s] - counts[s]
        for row in range(first_tile(mean[1], extent[1], rows), last_tile(mean[1], extent[1], rows)):
            for column in range(first_tile(mean[0], extent[0], columns), last_tile(mean[0], extent[0], columns)):
                keys[entry] = (wp.int64(row * columns + column) << wp.int64(32)) | wp.int64(depth_ranks[s])
                splats[entry] = s
                entry += 1


@wp.kernel
def find_tiles(keys: wp.array(dtype=wp.int64), entries: int, ranges: wp.array(dtype=wp.vec2i)):
    """Write where each tile's entries start and end."""
    i = wp.tid()
    tile = int(keys[i] >> wp.int64(32))
    before = wp.int32(-1)
    if i > 0:
        before = int(keys[i - 1] >> wp.int64(32))
    if tile != before:
        ranges[tile][0] = i
        if before >= 0:
            ranges[before][1] = i
    if i == entries - 1:
        ranges[tile][1] = entries


@wp.func
def falloff(mean: wp.vec2, root: wp.vec3, x: float, y: float):
    """Return dx, dy, t and s of exp(-(t^2 + s^2) / 2)."""
    dx, dy = x - mean[0], y - mean[1]
    return wp.vec4(dx, dy, root[0] * dx + root[1] * dy, root[2] * dy)


@wp.func
def alpha_of(opacity: float, f: wp.vec4):
    """Return a splat's alpha where its falloff is f, and 0 below the threshold."""
    alpha = wp.min(opacity * wp.exp(-0.5 * (f[2] * f[2] + f[3] * f[3])), LARGEST_ALPHA)
    return wp.where(alpha >= SMALLEST_ALPHA, alpha, 0.0)


@wp.kernel
def composite(
    columns: int, means: wp.array(dtype=wp.vec2), roots: wp.array(dtype=wp.vec3), opacities: wp.array(dtype=float),
    paint: wp.array(dtype=wp.vec3), ranges: wp.array(dtype=wp.vec2i), splats: wp.array(dtype=wp.int32),
    image: wp.array2d(dtype=wp.vec3), transmittance: wp.array2d(dtype=float), ends: wp.array2d(dtype=wp.int32),
    median: wp.array2d(dtype=wp.int32),
):  # fmt: skip
    """Write what is seen without background, the light left, and the splat that takes half of it, or -1.

    `ends` receives one past the last entry that each pixel takes.
    """
    y, x = wp.tid()
    span = ranges[(y // TILE) * columns + x // TILE]
    light = wp.float32(1.0)
    seen = wp.vec3(0.0, 0.0, 0.0)
    middle, end = wp.int32(-1), span[0]
    for k in range(span[0], span[1]):
        s = splats[k]
        alpha = alpha_of(opacities[s], falloff(means[s], roots[s], float(x) + 0.5, float(y) + 0.5))
        if alpha > 0.0:
            seen += light * alpha * paint[s]
            left = light - light * alpha
            if light > MEDIAN_TRANSMITTANCE and left <= MEDIAN_TRANSMITTANCE:
                middle = s
            light, end = left, k + 1
            if light < OPAQUE_TRANSMITTANCE:
                break
    image[y, x] = seen
    transmittance[y, x] = light
    ends[y, x] = end
    median[y, x] = middle


@wp.kernel
def composite_backward(
    columns: int, means: wp.array(dtype=wp.vec2), roots: wp.array(dtype=wp.vec3), opacities: wp.array(dtype=float),
    paint: wp.array(dtype=wp.vec3), ranges: wp.array(dtype=wp.vec2i), splats: wp.array(dtype=wp.int32),
    transmittance: wp.array2d(dtype=float), ends: wp.array2d(dtype=wp.int32),
    d_image: wp.array2d(dtype=wp.vec3), d_transmittance: wp.array2d(dtype=float),
    d_means: wp.array(dtype=wp.vec2), d_roots: wp.array(dtype=wp.vec3), d_opacities: wp.array(dtype=float),
    d_paint: wp.array(dtype=wp.vec3), d_screen: wp.array(dtype=wp.vec2),
):  # fmt: skip
    """Add the gradients of a pixel to those of its splats; see `compositing_kernels.composite_backward`.

    `d_screen` receives |dL/dmean| of every pixel.
    """
    y, x = wp.tid()
    start, end = ranges[(y // TILE) * columns + x // TILE][0], ends[y, x]
    outer = d_image[y, x]
    light = transmittance[y, x]
    rest = light * d_transmittance[y, x]
    for behind in range(end - start):
        s = splats[end - 1 - behind]
        root, opacity = roots[s], opacities[s]
        f = falloff(means[s], root, float(x) + 0.5, float(y) + 0.5)
        alpha = alpha_of(opacity, f)
        if alpha > 0.0:
            spread = 1.0 / (1.0 - alpha)
            light *= spread
            weight = light * alpha
            share = weight * wp.dot(outer, paint[s])
            wp.atomic_add(d_paint, s, weight * outer)
            if alpha < LARGEST_ALPHA:
                pull = share - alpha * spread * rest
                d_mean = wp.vec2(pull * f[2] * root[0], pull * (f[2] * root[1] + f[3] * root[2]))
                wp.atomic_add(d_means, s, d_mean)
                wp.atomic_add(d_screen, s, wp.vec2(wp.abs(d_mean[0]), wp.abs(d_mean[1])))
                wp.atomic_add(d_roots, s, -pull * wp.vec3(f[2] * f[0], f[2] * f[1], f[3] * f[1]))
                wp.atomic_add(d_opacities, s, pull / opacity)
            rest += share
