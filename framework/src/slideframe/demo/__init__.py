"""The embedded demo: a drone survey of a slope that never was, made the same way on every machine."""

from slideframe.demo.survey import write_demo_survey

# A failing box in the survey's frame, m: the bare scar with its sides, from behind the crest to across the road.
# z_min lies a few centimetres above the asphalt, so that the mass runs out over the road. The frame's origin is the
# mean of the camera positions; where the noisy positions place it, these numbers move by less than 2 cm.
DEMO_REGION = {"x_min": -14.0, "x_max": 18.0, "y_min": -18.0, "y_max": 40.0, "z_min": -55.85}

__all__ = ["DEMO_REGION", "write_demo_survey"]
