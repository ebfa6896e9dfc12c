"""What the soil bears and how far it has sheared, as colours of particles, of frames that carry it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from slideframe.arrays import Float32Array
from slideframe.products import ParticleFrame
from slideframe.record.drawing import IndexArray, heat

# colours end here, so that a single grain doesn't pale all others
BRIGHTEST = 99.0


def fields_of(frame: ParticleFrame) -> dict[str, Float32Array]:
    """Return what frames may carry, by the name of its entity: Pa, compression positive, and a strain."""
    pressure = np.maximum(-frame.mean_stresses, 0)
    fields = {
        "plastic_strain": frame.plastic_strains,
        "pressure": pressure,
        "deviatoric_stress": frame.deviatoric_stresses,
    }
    return {name: values for name, values in fields.items() if len(values)}


@dataclass(frozen=True)
class SoilColours:
    """The value that each field's brightest colour stands for: most of the particles at any time are below."""

    brightest: dict[str, float]

    @classmethod
    def over(cls, motion: Sequence[ParticleFrame], frames: IndexArray) -> "SoilColours":
        """Scale the colours by those of the frames that are drawn."""
        brightest: dict[str, float] = {}
        for index in frames:
            for name, values in fields_of(motion[int(index)]).items():
                brightest[name] = max(brightest.get(name, 0.0), float(np.percentile(values, BRIGHTEST)))
        return cls(brightest)

    def log(self, stream: rr.RecordingStream, frame: ParticleFrame, drawn: IndexArray, radius: float) -> None:
        """Log the drawn particles once for each field."""
        for name, values in fields_of(frame).items():
            brightest = self.brightest[name] or 1.0  # of what is zero everywhere
            colors = heat(values[drawn] / brightest)
            stream.log(f"soil/{name}", rr.Points3D(frame.positions[drawn], colors=colors, radii=radius))
