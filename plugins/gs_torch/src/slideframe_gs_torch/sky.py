"""Which pixels of a photograph show the sky: poses are known, and so is the ground, by the survey's sparse points."""

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.masks import Mask
from slideframe.products import Camera

# With fewer points a hill may stand higher than is known.
FEWEST_POINTS = 100
# The skyline is one height for each of so many sectors around the camera, that of the sector's and its neighbours'
# highest point but two: single points in the air are mismatches.
SECTORS = 180
HIGHEST_BUT = 2
# Grass and trees stand out over the highest points, degrees.
MARGIN = 1.5


def sky_pixels(points: Float32Array, camera: Camera, world_from_camera: Float64Array) -> Mask | None:
    """Return which pixels (height, width) look over the horizon and over all ground known; None where none does.

    Ground hides all that lies below its highest points, however far away they are. What a camera without distortion
    shows beyond the survey's points, above its own height, counts as sky.
    """
    slopes_x = (np.arange(camera.width) + 0.5 - camera.principal_x) / camera.focal_x
    slopes_y = (np.arange(camera.height) + 0.5 - camera.principal_y) / camera.focal_y
    local = np.stack([*np.meshgrid(slopes_x, slopes_y), np.ones((camera.height, camera.width))], axis=-1)
    if (local @ world_from_camera[2, :3]).max() <= 0 or len(points) < FEWEST_POINTS:
        return None
    azimuths, elevations = directions(local @ world_from_camera[:, :3].T)
    sky: Mask = elevations > skyline(points - world_from_camera[:, 3])[sectors(azimuths)] + MARGIN
    return sky if sky.any() else None


def skyline(offsets: Float64Array) -> Float64Array:
    """Return the elevation (sector,), degrees, up to which points (point, 3), as seen from the origin, hide the sky."""
    azimuths, elevations = directions(offsets)
    places = sectors(azimuths)
    highest = np.zeros(SECTORS)
    for sector in np.unique(places):
        seen = elevations[places == sector]
        if len(seen) > HIGHEST_BUT:
            highest[sector] = max(0.0, np.partition(seen, -1 - HIGHEST_BUT)[-1 - HIGHEST_BUT])
    return np.maximum(highest, np.maximum(np.roll(highest, 1), np.roll(highest, -1)))


def directions(offsets: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return azimuth and elevation of offsets (…, 3) in a frame whose z is up, degrees."""
    x, y, z = np.moveaxis(offsets, -1, 0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def sectors(azimuths: Float64Array) -> np.ndarray:
    """Return the sector of each azimuth, degrees."""
    return np.floor(azimuths / (360 / SECTORS)).astype(np.int64) % SECTORS
