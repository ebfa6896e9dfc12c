"""Five quick stages, so that the pipeline is tested without any backend. Each counts its calls in a file."""
