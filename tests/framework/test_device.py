import pytest

from slideframe.device import Device, cuda_device_count, parse_device
from slideframe.errors import ConfigurationError, MissingDependency


def test_cpu():
    assert parse_device("cpu") == Device("cpu")
    assert str(Device()) == "cpu"


def test_auto_takes_what_is_there():
    assert parse_device("auto").kind == ("cuda" if cuda_device_count() else "cpu")


@pytest.mark.parametrize("text", ["gpu", "cuda:x", "", "CPU "])
def test_unknown(text):
    with pytest.raises(ConfigurationError, match="auto, cpu, cuda or cuda:N"):
        parse_device(text)


def test_an_absent_card_is_told():
    with pytest.raises(MissingDependency, match="is not there"):
        parse_device("cuda:97")
