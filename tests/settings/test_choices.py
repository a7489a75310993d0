"""Names that the command line offers, compared with the modules that use them, which need torch."""

from torchsphere.benchmark import suites, trackers
from torchsphere.geometry import motion_models
from torchsphere.settings import choices


def test_models_are_those_of_the_motion_models() -> None:
    assert tuple(motion_models.MODELS) == choices.MODELS


def test_sizes_and_trackers_are_those_of_the_benchmark() -> None:
    assert tuple(suites.SIZES) == choices.SIZES
    assert trackers.names() == choices.TRACKERS
