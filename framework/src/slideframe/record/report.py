"""The result page, the configuration, and what the recording is of."""

import rerun as rr

from slideframe import __version__
from slideframe.config import RunConfig


def log_report(stream: rr.RecordingStream, result: str, config: str) -> None:
    """Log the result table (markdown) and the resolved config (TOML)."""
    stream.log("report/result", rr.TextDocument(result, media_type="text/markdown"), static=True)
    stream.log("report/config", rr.TextDocument(f"```toml\n{config}\n```", media_type="text/markdown"), static=True)


def send_properties(stream: rr.RecordingStream, config: RunConfig) -> None:
    """Make the recording's properties tell which stages made it, of what material, by which version."""
    made_by = config.stages.names()
    stream.send_property(
        "run", rr.AnyValues(drop_untyped_nones=True, slideframe=__version__, material=config.material.kind, **made_by)
    )
