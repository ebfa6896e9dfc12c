"""Low-anisotropy Gaussian splats by gradient descent."""

from slideframe.hookspecs import hookimpl
from slideframe_gs_torch.reconstructor import TorchSplats


@hookimpl
def slideframe_stage() -> type[TorchSplats]:
    """Offer the stage."""
    return TorchSplats
