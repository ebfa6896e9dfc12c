from pathlib import Path

import pytest

from slideframe.errors import InputError
from slideframe.formats.colmap import write_colmap_text
from slideframe.formats.colmap_binary import write_colmap_binary
from slideframe.formats.models import posed_model_files, read_posed_model
from slideframe.formats.posed_camera import posed_cameras
from slideframe.formats.transforms_json import write_transforms_json
from slideframe.products import Survey


@pytest.mark.parametrize("below", [".", "sparse/0", "cameras"])
@pytest.mark.parametrize("write", [write_colmap_text, write_colmap_binary])
def test_colmap_models_are_found_below_the_folder(survey: Survey, tmp_path: Path, below: str, write) -> None:
    write(survey, tmp_path / "project" / below)
    assert len(read_posed_model(tmp_path / "project").views) == 4
    files = posed_model_files(tmp_path / "project")
    assert len(files) == 3
    assert len(read_posed_model(files[0]).views) == 4, "the file itself may be named too"


def test_a_json_file_of_any_name_is_a_transforms_json(survey: Survey, tmp_path: Path) -> None:
    write_transforms_json(posed_cameras(survey), tmp_path / "cameras_train.json")
    assert len(read_posed_model(tmp_path / "cameras_train.json").views) == 4


def test_nothing_there_is_an_error_with_a_cure(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no camera model") as error:
        read_posed_model(tmp_path)
    assert "reconstruction.json" in str(error.value)
    with pytest.raises(InputError, match="doesn't exist"):
        read_posed_model(tmp_path / "nowhere")
