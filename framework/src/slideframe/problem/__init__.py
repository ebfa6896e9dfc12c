"""The problem: what is simulated and seen, handed identically to every backend. SI units, angles in degrees."""

from slideframe.problem.base import ProblemModel, Share, Vector, kind_of, kind_or, models_of
from slideframe.problem.boundary import Boundary, ColliderMesh, Domain, Wall
from slideframe.problem.camera_path import Shot
from slideframe.problem.grid import Grid, place_grid
from slideframe.problem.material import LAWS, DruckerPrager, Elastic, LawConstants, Material, Sand
from slideframe.problem.reference_ground import ReferenceGround
from slideframe.problem.region import BoxRegion, FillingProblem, MeshRegion, PolygonRegion, Region
from slideframe.problem.simulation import FEATURES, Simulation, SimulationProblem
from slideframe.problem.site import Site
from slideframe.problem.slip_surface import (
    DepthBase,
    EarlierGroundBase,
    EllipsoidBase,
    FlatBase,
    MapHeights,
    MeshBase,
    PlaneBase,
    RasterBase,
    SlblBase,
    SlipSurface,
)
from slideframe.problem.transfer import (
    AffineTransfer,
    BlendTransfer,
    SeparableTransfer,
    Transfer,
    TransferConstants,
)
from slideframe.problem.view import FileView, FlightView, OrbitView, SurveyView, View

__all__ = [
    "FEATURES",
    "LAWS",
    "AffineTransfer",
    "BlendTransfer",
    "Boundary",
    "BoxRegion",
    "ColliderMesh",
    "DepthBase",
    "Domain",
    "DruckerPrager",
    "EarlierGroundBase",
    "Elastic",
    "EllipsoidBase",
    "FileView",
    "FillingProblem",
    "FlatBase",
    "FlightView",
    "Grid",
    "LawConstants",
    "MapHeights",
    "Material",
    "MeshBase",
    "MeshRegion",
    "OrbitView",
    "PlaneBase",
    "PolygonRegion",
    "ProblemModel",
    "RasterBase",
    "ReferenceGround",
    "Region",
    "Sand",
    "SeparableTransfer",
    "Share",
    "Shot",
    "Simulation",
    "SimulationProblem",
    "Site",
    "SlblBase",
    "SlipSurface",
    "SurveyView",
    "Transfer",
    "TransferConstants",
    "Vector",
    "View",
    "Wall",
    "kind_of",
    "kind_or",
    "models_of",
    "place_grid",
]
