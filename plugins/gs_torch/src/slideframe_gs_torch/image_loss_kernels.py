"""L1 and SSIM with their gradient, compiled for the CPU.

SSIM of Wang et al. 2004 with an 11 x 11 Gaussian window of sigma 1.5, zero beyond the edge, as splat
papers report it. The window is separable: each row is blurred along itself and then across rows, in planes with a
border of zero rows. A task is one row of one channel.
"""

import numpy as np
from numba import njit

REACH = 5
_OFFSETS = np.arange(-REACH, REACH + 1)
_BELL = np.exp(-(_OFFSETS**2) / (2 * 1.5**2))
WINDOW = (_BELL / _BELL.sum()).astype(np.float32)
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
_W0, _W1, _W2, _W3, _W4, _W5 = WINDOW[5], WINDOW[4], WINDOW[3], WINDOW[2], WINDOW[1], WINDOW[0]
# indices are unsigned, or their signs would be looked at and the loops not become vectors
_EDGE = np.uint64(REACH)
_TWO, _ZERO, _ONE = np.float32(2.0), np.float32(0.0), np.float32(1.0)


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def weigh(numbers, i, step):
    """Return the window's sum over flat numbers that lie a step apart, from index i on."""
    return (
        _W5 * (numbers[i] + numbers[i + 10 * step])
        + _W4 * (numbers[i + step] + numbers[i + 9 * step])
        + _W3 * (numbers[i + 2 * step] + numbers[i + 8 * step])
        + _W2 * (numbers[i + 3 * step] + numbers[i + 7 * step])
        + _W1 * (numbers[i + 4 * step] + numbers[i + 6 * step])
        + _W0 * numbers[i + 5 * step]
    )


@njit(cache=True, fastmath=True, error_model="numpy")
def blur_row(padded, out):
    """Blur a row, which has REACH zeros at both ends, into `out`."""
    one = np.uint64(1)
    for x in range(np.uint64(len(out))):
        out[x] = weigh(padded, x, one)


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def blur_products(first_task, last_task, drawn, truth, blurred):
    """Blur x, y, xx, yy, xy along rows into `blurred` (5, channel, height + 2 REACH, width)."""
    _, height, width = drawn.shape
    padded = np.zeros((5, width + 2 * REACH), np.float32)
    for task in range(first_task, last_task):
        channel, y = task // height, task % height
        a, b = drawn[channel, y], truth[channel, y]
        for x in range(np.uint64(width)):
            padded[0, x + _EDGE] = a[x]
            padded[1, x + _EDGE] = b[x]
            padded[2, x + _EDGE] = a[x] * a[x]
            padded[3, x + _EDGE] = b[x] * b[x]
            padded[4, x + _EDGE] = a[x] * b[x]
        for k in range(5):
            blur_row(padded[k], blurred[k, channel, y + REACH])


@njit(cache=True, fastmath=True, error_model="numpy")
def blur_across(plane, y, out):
    """Blur a plane with its border across the rows round row y of the picture into `out` (width,)."""
    width = np.uint64(plane.shape[1])
    band = plane[y : y + 2 * REACH + 1].reshape(-1)
    for x in range(width):
        out[x] = weigh(band, x, width)


@njit(cache=True, fastmath=True, error_model="numpy")
def similarity_row(moments, raw):
    """Return the sum of SSIM over a row and write its slopes by mean, square and product into `raw`.

    `raw` (3, width + 2 REACH) keeps its border; `moments` (5, width) are the blurred x, y, xx, yy, xy.
    """
    total = _ZERO
    for x in range(np.uint64(moments.shape[1])):
        mean_a, mean_b = moments[0, x], moments[1, x]
        luminance = mean_a * mean_a + mean_b * mean_b + C1
        spread = moments[2, x] - mean_a * mean_a + moments[3, x] - mean_b * mean_b + C2
        shared = _TWO * mean_a * mean_b + C1
        together = _TWO * (moments[4, x] - mean_a * mean_b) + C2
        by_luminance, by_spread = _ONE / luminance, _ONE / spread
        scale = by_luminance * by_spread
        ssim = shared * together * scale
        by_square = -ssim * by_spread
        by_product = _TWO * shared * scale
        raw[0, x + _EDGE] = (
            _TWO * mean_b * together * scale
            - _TWO * mean_a * ssim * by_luminance
            - _TWO * mean_a * by_square
            - mean_b * by_product
        )
        raw[1, x + _EDGE] = by_square
        raw[2, x + _EDGE] = by_product
        total += ssim
    return total


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def compare(first_task, last_task, blurred, slopes, similarity):
    """Finish the blur and write SSIM's row sums and its slopes by mean, square and product, blurred along rows.

    Args:
        first_task: the first row of all channels' rows.
        last_task: one past the last row.
        blurred: (5, channel, height + 2 REACH, width) from `blur_products`.
        slopes: (3, channel, height + 2 REACH, width), out.
        similarity: (channel, height), out.
    """
    height, width = similarity.shape[1], blurred.shape[3]
    moments = np.empty((5, width), np.float32)
    padded = np.zeros((3, width + 2 * REACH), np.float32)
    for task in range(first_task, last_task):
        channel, y = task // height, task % height
        for k in range(5):
            blur_across(blurred[k, channel], y, moments[k])
        similarity[channel, y] = similarity_row(moments, padded)
        for k in range(3):
            blur_row(padded[k], slopes[k, channel, y + REACH])


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def combine(first_task, last_task, drawn, truth, slopes, ssim_weight, gradient, difference):
    """Write the gradient of (1 - weight) L1 + weight (1 - SSIM), both means, and the row sums of |drawn - truth|."""
    _, height, width = drawn.shape
    by_l1 = np.float32((1 - ssim_weight) / drawn.size)
    by_ssim = np.float32(-ssim_weight / drawn.size)
    parts = np.empty((3, width), np.float32)
    for task in range(first_task, last_task):
        channel, y = task // height, task % height
        for k in range(3):
            blur_across(slopes[k, channel], y, parts[k])
        total = _ZERO
        for x in range(np.uint64(width)):
            a, b = drawn[channel, y, x], truth[channel, y, x]
            error = a - b
            total += abs(error)
            sign = by_l1 if error > _ZERO else (-by_l1 if error < _ZERO else _ZERO)
            gradient[channel, y, x] = sign + by_ssim * (parts[0, x] + _TWO * a * parts[1, x] + b * parts[2, x])
        difference[channel, y] = total
