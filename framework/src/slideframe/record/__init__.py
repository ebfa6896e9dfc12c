"""The rerun recording: one function per product, one blueprint. The only importer of rerun.

Everything is in the local east-north-up frame. Moving and static splats are one entity, because the viewer
sorts splats per entity. What is drawn is thinned to a budget; the store keeps everything.
"""

from slideframe.record.blueprint import Eye
from slideframe.record.bodies import log_bodies
from slideframe.record.film import log_film
from slideframe.record.motion import log_motion
from slideframe.record.report import log_report
from slideframe.record.scene import log_splats, log_survey, log_survey_maps
from slideframe.record.stream import Recording
from slideframe.record.volume import log_filling

__all__ = [
    "Eye",
    "Recording",
    "log_bodies",
    "log_filling",
    "log_film",
    "log_motion",
    "log_report",
    "log_splats",
    "log_survey",
    "log_survey_maps",
]
