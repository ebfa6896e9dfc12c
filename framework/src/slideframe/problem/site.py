"""Where the photographs are."""

from pathlib import Path

from pydantic import Field

from slideframe.problem.base import ProblemModel


class Site(ProblemModel):
    """The place and its photographs."""

    photographs: Path = Field(description="folder of JPEG photographs with GPS metadata, searched recursively")
