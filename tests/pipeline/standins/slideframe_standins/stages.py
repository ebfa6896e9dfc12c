"""The five stages: a few splats over a slope, a falling block, and grey pictures of its height."""

import hashlib
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from slideframe.errors import InputError
from slideframe.problem import FillingProblem, SimulationProblem, Site, View
from slideframe.products import (
    Camera,
    Filling,
    Georeference,
    ParticleFrame,
    Photograph,
    Picture,
    SplatCloud,
    Survey,
)
from slideframe.stages import Context, PoseSource, Reconstructor, Renderer, Solver, VolumeFiller


def count_call(name: str) -> None:
    """Note the call where SLIDEFRAME_TEST_CALLS says, and die there if asked to."""
    calls = os.environ.get("SLIDEFRAME_TEST_CALLS")
    if calls:
        with Path(calls).open("a") as stream:
            stream.write(name + "\n")


def splat_cloud(centers: np.ndarray, size: float = 0.2) -> SplatCloud:
    count = len(centers)
    return SplatCloud(
        centers=centers.astype(np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        scales=np.full((count, 3), size, np.float32),
        opacities=np.full(count, 0.9, np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )


class StandinPoses(PoseSource):
    name = "standin_poses"
    height: float = Field(default=30.0, gt=0, description="of the cameras, m")

    def input_files(self, site: Site) -> Sequence[Path]:
        return sorted(site.photographs.glob("*.jpg"))

    def preflight(self, problem, device) -> None:
        if not self.input_files(problem):
            raise InputError("no photographs", where=str(problem.photographs), cure="add some")

    def locate(self, site: Site, context: Context) -> Survey:
        count_call(self.name)
        files = self.input_files(site)
        poses = np.zeros((len(files), 3, 4))
        poses[:, :, :3] = np.diag([1.0, -1.0, -1.0])
        poses[:, 2, 3] = self.height
        context.figure("reprojection_error_px", 0.5)
        return Survey(
            georeference=Georeference(latitude=45.0, longitude=7.0, ellipsoidal_height=300.0),
            cameras=(Camera(width=40, height=30, focal_x=40, focal_y=40, principal_x=20, principal_y=15),),
            photographs=tuple(
                Photograph(path=file, camera=0, sha256=hashlib.sha256(file.read_bytes()).hexdigest()) for file in files
            ),
            world_from_camera=poses,
            position_sigma=np.full((len(files), 3), 0.02),
            sparse_points=np.float32([[x, y, 0] for x in range(10) for y in range(10)]),
            sparse_colors=np.full((100, 3), 120, np.uint8),
            sparse_errors=np.full(100, 0.5, np.float32),
        )


class StandinSplats(Reconstructor):
    name = "standin_splats"
    iterations: int = Field(default=3, ge=1, description="steps")
    seconds: float = Field(default=0.0, ge=0, description="seconds each step takes")
    size: float = Field(default=0.2, gt=0, description="m")
    give_nan: bool = False
    notes: Path | None = Field(default=None, description="a file that the splats depend on")

    def reconstruct(self, survey: Survey, context: Context) -> SplatCloud:
        count_call(self.name)
        for step in range(self.iterations):
            time.sleep(self.seconds)
            context.progress(step + 1, self.iterations)
        # a stage that isn't repeatable: something outside its options decides
        centers = survey.sparse_points + np.float32(os.environ.get("SLIDEFRAME_TEST_SHIFT", "0"))
        if self.give_nan:
            centers[7, 2] = np.nan
        context.figure("held_out_psnr_db", np.float32(30.0))
        return splat_cloud(centers, self.size)


class StandinFiller(VolumeFiller):
    name = "standin_filler"

    def fill(self, survey: Survey, splats: SplatCloud, problem: FillingProblem, context: Context) -> Filling:
        count_call(self.name)
        particles = splats.centers[::2] - np.float32([0, 0, 1])
        count = len(particles)
        return Filling(
            bounds=np.array([[0, 0, -5], [9, 9, 1]], np.float64),
            particle_positions=particles,
            particle_volumes=np.full(count, problem.particle_spacing**3, np.float32),
            interior=splat_cloud(particles),
            interior_particles=np.arange(count, dtype=np.int32),
            surface_particles=np.repeat(np.arange(count, dtype=np.int32), 2),
            surface_vertices=np.float32([[0, 0, 0], [9, 0, 0], [0, 9, 0]]),
            surface_triangles=np.int32([[0, 1, 2]]),
            surface_support=np.uint8([0, 1, 2]),
        )


class StandinSolver(Solver):
    name = "standin_solver"
    seconds: float = Field(default=0.0, ge=0, description="seconds each frame takes")
    fail_at: int = -1
    leave_out: int = Field(default=0, ge=0, description="frames missing at the end")
    resumes: bool = Field(default=False, description="go on after the frames of a run that broke off")

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        count_call(self.name)
        gravity = np.asarray(problem.simulation.gravity)
        identity = np.tile(np.eye(3, dtype=np.float32), (len(filling.particle_positions), 1, 1))
        first = 0
        if self.resumes:
            first = context.stored
            context.resume(first)
        for index in range(first, problem.simulation.frame_count - self.leave_out):
            if self.resumes:
                count_call(f"frame-{index}")
            if index == self.fail_at:
                raise ZeroDivisionError("planted")
            time.sleep(self.seconds)
            moment = index / problem.simulation.frame_rate
            yield ParticleFrame(
                time=moment,
                positions=(filling.particle_positions + 0.5 * gravity * moment**2).astype(np.float32),
                velocities=np.broadcast_to(gravity * moment, filling.particle_positions.shape).astype(np.float32),
                deformation_gradients=identity,
            )
            context.progress(index + 1, problem.simulation.frame_count)


class StandinRenderer(Renderer):
    name = "standin_renderer"

    def render(
        self,
        survey: Survey,
        splats: SplatCloud,
        filling: Filling,
        motion: Iterable[ParticleFrame],
        view: View,
        context: Context,
    ) -> Iterator[Picture]:
        count_call(self.name)
        for frame in motion:
            grey = int(np.clip(128 + 10 * frame.positions[:, 2].mean(), 0, 255))
            yield Picture(time=frame.time, pixels=np.full((view.height, view.width, 3), grey, np.uint8))


class OtherSolver(StandinSolver):
    name = "other_solver"

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        for frame in super().solve(filling, problem, context):
            yield frame.model_copy(update={"positions": frame.positions + np.float32(frame.time)})
