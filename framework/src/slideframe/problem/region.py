"""Where the moving mass is."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from slideframe.problem.base import ProblemModel


class BoxRegion(ProblemModel):
    """The box that holds the moving mass; the ground surface closes it above."""

    kind: Literal["box"] = "box"
    x_min: float = Field(description="west side, m")
    x_max: float = Field(description="east side, m")
    y_min: float = Field(description="south side, m")
    y_max: float = Field(description="north side, m")
    z_min: float = Field(description="flat base, m")

    @model_validator(mode="after")
    def _sides_in_order(self) -> "BoxRegion":
        for low, high in (("x_min", "x_max"), ("y_min", "y_max")):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(f"{low} must be less than {high}")
        return self

    @property
    def plan_size(self) -> tuple[float, float] | None:
        """Width and depth of the plan, m; none where only the survey can tell."""
        return self.x_max - self.x_min, self.y_max - self.y_min


Region = Annotated[BoxRegion, Field(description="where the moving mass is")]


class FillingProblem(ProblemModel):
    """What a volume filler is asked for."""

    region: Region
    particle_spacing: float = Field(gt=0, description="m")
