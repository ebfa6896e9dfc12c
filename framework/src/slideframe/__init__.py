"""Drone photographs of a slope to its photorealistic, physically simulated failure."""

__version__ = "0.1.0"
