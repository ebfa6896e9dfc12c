"""Where the photographs are."""

from pathlib import Path

from pydantic import Field

from slideframe.problem.base import ProblemModel


class Site(ProblemModel):
    """The place and its photographs."""

    photographs: Path = Field(description="folder of JPEG photographs with GPS metadata, searched recursively")
    masks: Path | None = Field(
        default=None,
        description="folder of masks named like the photographs, NAME.png or NAME_mask.png; black isn't used",
    )
