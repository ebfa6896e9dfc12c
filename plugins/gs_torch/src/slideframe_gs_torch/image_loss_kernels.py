"""L1 and SSIM with their gradient, compiled for the CPU.

SSIM of Wang et al. 2004 with an 11 x 11 Gaussian window of sigma 1.5, zero beyond the edge, as splat
papers report it. The window is separable, so each row is blurred along itself and then across rows.
"""

import numpy as np
from numba import njit

REACH = 5
_OFFSETS = np.arange(-REACH, REACH + 1)
_BELL = np.exp(-(_OFFSETS**2) / (2 * 1.5**2))
WINDOW = (_BELL / _BELL.sum()).astype(np.float32)
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
_TWO = np.float32(2.0)


@njit(cache=True, fastmath=True, error_model="numpy")
def blur_row(row, padded, out):
    """Blur one row into `out`; `padded` (width + 2 REACH,) must be zero at both ends."""
    width = len(out)
    for x in range(width):
        padded[x + REACH] = row[x]
        out[x] = 0.0
    for j in range(2 * REACH + 1):
        weight = WINDOW[j]
        for x in range(width):
            out[x] += weight * padded[x + j]


@njit(cache=True, fastmath=True, error_model="numpy")
def blur_across(plane, y, out):
    """Blur a plane across its rows at row y into `out` (width,)."""
    height, width = plane.shape
    out[:] = 0.0
    for j in range(max(-REACH, -y), min(REACH, height - 1 - y) + 1):
        weight, row = WINDOW[j + REACH], plane[y + j]
        for x in range(width):
            out[x] += weight * row[x]


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def blur_products(first_task, last_task, drawn, truth, blurred):
    """Blur x, y, xx, yy, xy along rows into `blurred` (5, channel, height, width)."""
    _, height, width = drawn.shape
    for task in range(first_task, last_task):
        channel, y = task // height, task % height
        padded = np.zeros(width + 2 * REACH, np.float32)
        a, b = drawn[channel, y], truth[channel, y]
        blur_row(a, padded, blurred[0, channel, y])
        blur_row(b, padded, blurred[1, channel, y])
        blur_row(a * a, padded, blurred[2, channel, y])
        blur_row(b * b, padded, blurred[3, channel, y])
        blur_row(a * b, padded, blurred[4, channel, y])


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def compare(first_task, last_task, blurred, slopes, similarity):
    """Finish the blur and write SSIM's row sums and its slopes by mean, square and product, blurred along rows.

    Args:
        first_task: the first row of all channels' rows.
        last_task: one past the last row.
        blurred: (5, channel, height, width) from `blur_products`.
        slopes: (3, channel, height, width), out.
        similarity: (channel, height), out.
    """
    _, _, height, width = blurred.shape
    for task in range(first_task, last_task):
        channel, y = task // height, task % height
        moments = np.empty((5, width), np.float32)
        for k in range(5):
            blur_across(blurred[k, channel], y, moments[k])
        raw = np.empty((3, width), np.float32)
        total = 0.0
        for x in range(width):
            mean_a, mean_b = moments[0, x], moments[1, x]
            luminance = mean_a * mean_a + mean_b * mean_b + C1
            spread = moments[2, x] - mean_a * mean_a + moments[3, x] - mean_b * mean_b + C2
            shared = _TWO * mean_a * mean_b + C1
            together = _TWO * (moments[4, x] - mean_a * mean_b) + C2
            scale = np.float32(1.0) / (luminance * spread)
            ssim = shared * together * scale
            by_square = -ssim / spread
            by_product = _TWO * shared * scale
            raw[0, x] = (
                _TWO * mean_b * together * scale
                - _TWO * mean_a * ssim / luminance
                - _TWO * mean_a * by_square
                - mean_b * by_product
            )
            raw[1, x] = by_square
            raw[2, x] = by_product
            total += ssim
        similarity[channel, y] = total
        padded = np.zeros(width + 2 * REACH, np.float32)
        for k in range(3):
            blur_row(raw[k], padded, slopes[k, channel, y])


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def combine(first_task, last_task, drawn, truth, slopes, ssim_weight, gradient, difference):
    """Write the gradient of (1 - weight) L1 + weight (1 - SSIM), both means, and the row sums of |drawn - truth|."""
    _, height, width = drawn.shape
    by_l1 = np.float32((1 - ssim_weight) / drawn.size)
    by_ssim = np.float32(-ssim_weight / drawn.size)
    for task in range(first_task, last_task):
        channel, y = task // height, task % height
        parts = np.empty((3, width), np.float32)
        for k in range(3):
            blur_across(slopes[k, channel], y, parts[k])
        total = 0.0
        for x in range(width):
            a, b = drawn[channel, y, x], truth[channel, y, x]
            error = a - b
            total += abs(error)
            sign = by_l1 if error > 0 else (-by_l1 if error < 0 else np.float32(0.0))
            gradient[channel, y, x] = sign + by_ssim * (parts[0, x] + _TWO * a * parts[1, x] + b * parts[2, x])
        difference[channel, y] = total
