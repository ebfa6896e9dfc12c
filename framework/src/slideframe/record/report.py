"""The result page and the configuration."""

import rerun as rr


def log_report(stream: rr.RecordingStream, result: str, config: str) -> None:
    """Log the result table (markdown) and the resolved config (TOML)."""
    stream.log("report/result", rr.TextDocument(result, media_type="text/markdown"), static=True)
    stream.log("report/config", rr.TextDocument(f"```toml\n{config}\n```", media_type="text/markdown"), static=True)
