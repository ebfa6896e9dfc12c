"""From poses to sparse points and better poses: triangulation and bundle adjustment, in rounds of rising strictness."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slideframe_pose_rtk.database import image_and_frame, rig_of
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.freedom import Freedom
from slideframe_pose_rtk.trust import Trust

if TYPE_CHECKING:
    import pycolmap

# A pose from metadata is off by some degrees and centimetres, and every point is seen displaced by as much. Points are
# therefore accepted at first within 6 degrees (the worst gimbal and compass found on real flights was 5), and
# ever more strictly as the poses improve.
ACCEPTED_ANGLES = (6.0, 1.5, 0.4)  # degrees
ACCEPTED_PIXELS = 4.0  # in the last round, as in COLMAP
# Observations beyond this share of what is accepted pull less and less (Cauchy's loss).
LOSS_SHARE = 1 / 20
LEAST_LOSS_PIXELS = 1.0
LEAST_OBSERVATIONS = 30  # points that a photograph must see to have a pose of its own
ITERATIONS = 50
# Relative change of cost at which an iteration is the last one; earlier rounds only have to end closer than they began.
FUNCTION_TOLERANCE = 1e-6
EARLY_FUNCTION_TOLERANCE = 1e-4


def triangulate(
    database: Path,
    flight: Flight,
    lenses: "list[pycolmap.Camera]",
    poses: Poses,
    accepted: float,
    seed: int,
    scratch: Path,
) -> "pycolmap.Reconstruction":
    """Return the points on which photographs with the given poses agree within `accepted` px."""
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = options.mapper.num_threads = 1  # several threads add up in any order
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = seed
    options.extract_colors = False
    angle = float(np.degrees(np.arctan(accepted / lenses[0].mean_focal_length())))
    rules = options.triangulation
    rules.create_max_angle_error = rules.continue_max_angle_error = rules.re_max_angle_error = angle
    rules.merge_max_reproj_error = rules.complete_max_reproj_error = accepted
    options.mapper.filter_max_reproj_error = accepted
    # the bundle adjustment that follows triangulation in COLMAP keeps poses; ours comes after, with priors
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.ba_global_max_num_iterations = 1
    return pycolmap.triangulate_points(
        _posed(flight, lenses, poses), database, flight.folder, scratch, clear_points=True, options=options
    )


def adjust(
    reconstruction: "pycolmap.Reconstruction",
    priors: "list[pycolmap.PosePrior]",
    freedom: Freedom,
    accepted: float,
    seed: int,
    fixed_points: Sequence[int] = (),
    *,
    robust: bool,
) -> None:
    """Improve poses, points and what is free of the cameras, holding centres to their priors.

    Where `robust`, centres far from their prior pull less and less, so that false positions don't bend the survey.
    """
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = freedom.focal_length
    options.refine_extra_params = freedom.distortion
    options.refine_principal_point = freedom.principal_point
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = max(LEAST_LOSS_PIXELS, accepted * LOSS_SHARE)
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = ITERATIONS
    options.ceres.solver_options.function_tolerance = (
        FUNCTION_TOLERANCE if accepted <= ACCEPTED_PIXELS else EARLY_FUNCTION_TOLERANCE
    )
    prior_options = pycolmap.PosePriorBundleAdjustmentOptions()
    prior_options.alignment_ransac.random_seed = seed
    if robust:
        prior_options.ceres.prior_position_loss_function_type = pycolmap.LossFunctionType.CAUCHY
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in reconstruction.reg_image_ids():
        config.add_image(image_id)
    for camera in freedom.held:
        config.set_constant_cam_intrinsics(camera + 1)
    for number in fixed_points:
        config.add_constant_point(number)
    pycolmap.create_pose_prior_bundle_adjuster(options, prior_options, config, priors, reconstruction).solve()
    reconstruction.update_point_3d_errors()


def poses_of(reconstruction: "pycolmap.Reconstruction") -> Poses:
    """Return world from camera (3, 4) of the photographs that see enough points to have a pose of their own."""
    poses = {}
    for image_id in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(image_id)
        if image.num_points3D >= LEAST_OBSERVATIONS:
            poses[image_id - 1] = np.array(image.cam_from_world().inverse().matrix(), np.float64)
    return poses


def metadata_poses(flight: Flight) -> Poses:
    """Return world from camera (3, 4) of the photographs whose gimbal angles are known."""
    return {
        int(index): np.column_stack([flight.rotations[index], flight.positions[index]])
        for index in np.flatnonzero(flight.oriented)
    }


def accepted_pixels(flight: Flight) -> list[float]:
    """Return what each round accepts, px; the last one is the same for every camera."""
    focal_length = max(camera.focal_x for camera in flight.cameras)
    return [focal_length * float(np.tan(np.radians(angle))) for angle in ACCEPTED_ANGLES] + [ACCEPTED_PIXELS]


def priors_of(reconstruction: "pycolmap.Reconstruction", flight: Flight, trust: Trust) -> "list[pycolmap.PosePrior]":
    """Return the trusted positions with their covariance, east, north, up.

    Gravity stays undefined: COLMAP would read it from EXIF's orientation, which is wrong for a nadir view.
    """
    import pycolmap

    priors = []
    for image_id in sorted(reconstruction.reg_image_ids()):
        if image_id - 1 in trust.distrusted:
            continue
        prior = pycolmap.PosePrior()
        prior.corr_data_id = reconstruction.image(image_id).data_id
        prior.position = flight.positions[image_id - 1]
        prior.position_covariance = trust.sigma_scale**2 * flight.records[image_id - 1].position_covariance
        prior.coordinate_system = pycolmap.PosePriorCoordinateSystem.CARTESIAN
        priors.append(prior)
    return priors


def _posed(flight: Flight, lenses: "list[pycolmap.Camera]", poses: Poses) -> "pycolmap.Reconstruction":
    import pycolmap

    reconstruction = pycolmap.Reconstruction()
    for lens in lenses:
        reconstruction.add_camera(lens)
        reconstruction.add_rig(rig_of(lens))
    for index in range(len(flight)):
        image, frame = image_and_frame(flight, index)
        if index in poses:
            rotation, center = poses[index][:, :3], poses[index][:, 3]
            frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation.T), -rotation.T @ center)
        reconstruction.add_frame(frame)
        image.frame_id = frame.frame_id
        reconstruction.add_image(image)
        if index in poses:
            reconstruction.register_frame(frame.frame_id)
    return reconstruction
