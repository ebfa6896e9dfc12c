"""The reconstructor stage; its backend is imported only when it computes."""

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from slideframe.products import SplatCloud, Survey
from slideframe.stages import Context, Reconstructor

Densification = Literal["budgeted_splits", "mcmc", "clone_and_split"]


def _not_all(hold_out_every: int) -> int:
    if hold_out_every == 1:
        raise ValueError("1 would hold every photograph out: give 0 for none, or 2 or more")
    return hold_out_every


class TorchSplats(Reconstructor):
    """Optimises low-anisotropy 3D Gaussian splats by gradient descent on the photographs."""

    name: ClassVar[str] = "gs_torch"
    backend: ClassVar[tuple[str, ...]] = ("torch", "numba", "scipy")

    iterations: int = Field(default=2000, ge=1, le=1_000_000, description="photographs shown, one per iteration")
    splat_budget: int = Field(
        default=300_000, ge=100, le=10_000_000, description="most splats that densification makes"
    )
    start_share: float = Field(
        default=0.75,
        ge=0,
        le=1,
        description="share of the budget that training starts with: points between the survey's sparse ones and beyond "
        "them, so that ground that few photographs show has its splats as well; 0: the sparse points alone",
    )
    blocks: int = Field(
        default=1,
        ge=1,
        le=1000,
        description="parts of a large site, trained one after the other, each on the photographs that see it, with all "
        "iterations and the whole budget of splats: memory is that of one",
    )
    densification: Densification = Field(
        default="budgeted_splits",
        description="where splats are added: 'budgeted_splits' splits those that the picture pulls at most until the "
        "budget is reached; 'mcmc' is that of Kheradmand et al. 2024; 'clone_and_split' that of Kerbl et al. 2023 with "
        "absolute gradients",
    )
    image_width: int = Field(
        default=640, ge=16, le=16_384, description="px that photographs are reduced to for training"
    )
    harmonics_degree: int = Field(default=1, ge=0, le=3, description="degree of the view-dependent colour")
    anisotropy_limit: float = Field(default=3.0, gt=1, le=100, description="r: largest ratio of a splat's scales")
    anisotropy_weight: float = Field(default=0.6, ge=0, description="lambda of the anisotropy loss")
    ssim_weight: float = Field(default=0.2, ge=0, le=1, description="share of 1 - SSIM in the image loss, beside L1")
    depth_weight: float = Field(
        default=0.0,
        ge=0,
        description="weight of the depth of the survey's sparse points in the loss, relative to their distance; it "
        "costs about as much time as the colours",
    )
    exposure_correction: bool = Field(
        default=False, description="learn a gain and an offset of each channel for every photograph"
    )
    near_share: float = Field(
        default=0.2,
        ge=0,
        lt=1,
        description="splats nearer to a camera than this share of its distance to the scene float, and are taken away",
    )
    settle_gain: float = Field(
        default=0.02,
        ge=0,
        description="training ends early once a tenth of the iterations gains less than this held out, dB; 0: never",
    )
    hold_out_every: Annotated[int, AfterValidator(_not_all)] = Field(
        default=8, ge=0, description="every n-th photograph only measures; 0: all train"
    )
    background: tuple[float, float, float] | None = Field(
        default=None,
        description="sRGB, 0 to 1, seen in training where no splat is; none: the mean colour of the photographs",
    )
    photographs_megabytes: int = Field(
        default=1000,
        ge=0,
        description="memory for photographs in training, MB; those beyond are kept on disk, undistorted and reduced, "
        "and read when they are shown",
    )
    previews: int = Field(
        default=12,
        ge=0,
        le=1000,
        description="pictures of how training comes along, of a photograph held out beside its splats, that the "
        "recording shows; 0: none",
    )
    sky: Literal["clear", "keep"] = Field(
        default="clear",
        description="what looks over the horizon and over all ground that the survey's sparse points show: 'clear' "
        "lets no splat stand before it, and leaves it out of every measure; 'keep' trains it as if it were ground",
    )
    opaque_weight: float = Field(
        default=0.02,
        ge=0,
        description="weight in the loss of the mean share of light that passes all splats, beyond a twentieth: without "
        "it the ground stays translucent where the background has the right colour",
    )

    def reconstruct(self, survey: Survey, context: Context) -> SplatCloud:
        """Return the splats of the scene as photographed."""
        from slideframe_gs_torch.site_training import train_site

        return train_site(self, survey, context)
