"""What a run leaves for people, beside its results: nothing here decides a result."""

from pydantic import Field

from slideframe.problem import ProblemModel


class Outputs(ProblemModel):
    """What the run folder holds for looking at."""

    overlay: bool = Field(default=False, description="time, scale bar and legend on the film and its pictures")
    contact_sheet: int = Field(default=12, ge=0, le=400, description="pictures on contact_sheet.png; 0: no sheet")
    recording_megabytes: float = Field(
        default=300.0, ge=10, description="most that recording.rrd may take; frames of the motion are left out for it"
    )
