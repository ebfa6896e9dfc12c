"""The conformance kit on splats from a file, which the trained ones are written to first."""

import pytest

from slideframe.formats.splat_file import write_splats
from slideframe.testing import checks_for, reconstructor_checks
from slideframe_gs_import.reconstructor import ImportedSplats
from slideframe_gs_torch.reconstructor import TorchSplats

# as in test_plugins, whose training is reused
TRAINED = TorchSplats(iterations=60, image_width=160, splat_budget=12_000)


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    path = tmp_path_factory.mktemp("splats") / "trained.ply"
    write_splats(reconstructor_checks._splats(TRAINED), path)
    return ImportedSplats(splats=path)


@pytest.mark.parametrize("name", [check.name for check in checks_for(ImportedSplats(splats="splats.ply"))])
def test_conformance(stage, name):
    next(check for check in checks_for(stage) if check.name == name)()
