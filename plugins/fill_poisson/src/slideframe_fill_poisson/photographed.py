"""The ground's colours in the photographs."""

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.photographs import load_photograph
from slideframe.products import Survey
from slideframe_fill_poisson.support import seen_from

# Detail finer than this many particle spacings is left out: a splat of the interior is about as wide.
PIXEL_SPACINGS = 0.5
LEAST_WIDTH = 64  # px


def photographed_colors(points: Float32Array, survey: Survey, point_spacing: float, spacing: float) -> Float32Array:
    """Return the sRGB colour (point, 3), 0 to 1, of each point in the nearest photograph that sees it.

    NaN where none does. Photographs that are no longer there are passed over.

    Args:
        points: on the ground (point, 3), m.
        survey: the photographs and their cameras.
        point_spacing: of the points, m.
        spacing: of the particles, m.
    """
    places = points.astype(np.float64)
    nearest, chosen = np.full(len(points), np.inf), np.full(len(points), -1)
    for index, photograph in enumerate(survey.photographs):
        if photograph.path.is_file():
            distance = np.linalg.norm(survey.world_from_camera[index, :, 3] - places, axis=1)
            better = seen_from(places, survey, index, point_spacing) & (distance < nearest)
            nearest[better], chosen[better] = distance[better], index
    colors = np.full((len(points), 3), np.nan, np.float32)
    for index in np.unique(chosen[chosen >= 0]):
        mine = np.flatnonzero(chosen == index)
        colors[mine] = _sampled(places[mine], survey, int(index), spacing)
    return colors


def _sampled(points: Float64Array, survey: Survey, index: int, spacing: float) -> Float32Array:
    """Return the colour (point, 3) of a photograph's pixel at each point; NaN beside the picture or its mask."""
    full, pose = survey.camera_of(index), survey.world_from_camera[index]
    local = (points - pose[:, 3]) @ pose[:, :3]
    pixel = PIXEL_SPACINGS * spacing / float(np.median(local[:, 2])) * full.focal_x
    width = int(np.clip(full.width / pixel, LEAST_WIDTH, full.width))
    pixels, camera, used = load_photograph(survey, index, width=width)
    column = np.floor(camera.focal_x * local[:, 0] / local[:, 2] + camera.principal_x).astype(np.int64)
    row = np.floor(camera.focal_y * local[:, 1] / local[:, 2] + camera.principal_y).astype(np.int64)
    within = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    if used is not None:
        within[within] = used[row[within], column[within]]
    colors = np.full((len(points), 3), np.nan, np.float32)
    colors[within] = pixels[row[within], column[within]] / np.float32(255)
    return colors
