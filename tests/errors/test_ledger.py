"""The ledger: what each source adds, in squares, is what the track states."""

import dataclasses
import pkgutil
from pathlib import Path

import numpy as np
import pytest
import shots
import torch

import torchsphere as ts
from torchsphere import errors
from torchsphere.errors import ledger
from torchsphere.motion.ledger import read
from torchsphere.runtime.warning_levels import LEVELS, level_of

#: Modules of the package that are no source of error.
NO_SOURCE = {"background_blocks", "evidence", "ledger", "source"}


@pytest.fixture(scope="module")
def images() -> np.ndarray:
    return shots.shot(0, n=8, radius=25.0, start=(60.0, 60.0)).images[:, :130, :150].numpy()


@pytest.fixture(scope="module", params=[None, False], ids=["on a map", "by pairs"])
def track(request: pytest.FixtureRequest, images: np.ndarray) -> ts.Track:
    circle = ts.Circle(60.0, 60.0, 25.0, 0.1, 0.1, 0.05)
    return ts.track(images, circle, sphere_map=request.param, diameter_m=0.03, log=False)


def test_the_entries_add_in_squares_to_what_the_track_states(track: ts.Track) -> None:
    step = np.nanmedian(np.diagonal(track.covariance, axis1=1, axis2=2), axis=0)
    circle = np.square([track.circle.sd_x, track.circle.sd_y, track.circle.sd_radius])
    scale = (track.circle.sd_radius / track.circle.radius) ** 2
    for name, stated in (("step", step), ("steady", track.sd_steady**2), ("circle", circle), ("scale", scale)):
        added = sum(np.square(getattr(entry, name)) for entry in track.ledger)
        np.testing.assert_allclose(added, stated, rtol=1e-6, err_msg=name)


def test_the_noise_and_the_distance_of_the_camera_are_named(track: ts.Track) -> None:
    entries = {entry.source: entry for entry in track.ledger}
    noise, distance = entries[ledger.NOISE], entries["distance of the camera"]
    assert min(noise.step) > 0
    # An unknown distance tells a wrong turn, and no wrong step.
    assert distance.steady[3] > 0
    assert distance.steady[:2] == (0, 0)
    assert not any(distance.step)


def test_a_scale_that_was_given_with_an_uncertainty_has_an_entry(track: ts.Track) -> None:
    calibration = dataclasses.replace(track.calibration, relative_sd_scale=0.02)
    uncertain = dataclasses.replace(track, calibration=calibration)
    (given,) = ledger._added(ledger.STATED_SCALE, track, uncertain)
    assert given.scale == pytest.approx(0.02)
    assert not any((*given.step, *given.steady, *given.circle))


def test_a_source_that_adds_nothing_has_no_entry(track: ts.Track) -> None:
    assert ledger._added("nothing", track, track) == []
    assert ledger._added("nothing", track, dataclasses.replace(track, warnings=())) == []


def test_the_ledger_returns_from_its_summary(track: ts.Track) -> None:
    assert read([entry.items() for entry in track.ledger]) == track.ledger


def test_each_module_of_the_package_is_a_source_of_error_and_each_source_is_applied_once() -> None:
    modules = {found.name for found in pkgutil.iter_modules(errors.__path__)} - NO_SOURCE
    applied = set()
    for source in ledger.SOURCES:
        homes = {
            function.__module__.rpartition(".")[2]
            for function in (source.detect, source.widen, source.without, source.sentences)
        } - {"source"}
        # An error that all steps share is computed for several sources in one place.
        applied |= homes - ({"steady_error"} if len(homes) > 1 else set())
    assert applied == modules
    names = [source.name for source in ledger.SOURCES]
    assert len(set(names)) == len(names)


def test_no_other_module_widens_the_uncertainty_of_a_track() -> None:
    package = Path(ts.__file__).parent
    for path in package.glob("tracking/*.py"):
        assert "sd_steady=" not in path.read_text().replace("sd_steady=np.zeros(5)", ""), path.name


def test_missing_images_are_found_beside_images_that_hold_a_part_of_others() -> None:
    made = shots.shot(0, n=12, radius=25.0, start=(60.0, 60.0), step=(4.0, 1.0), jitter=0.0, noise=0.0).images[:, :130]
    noise = 4 * torch.randn(made.shape, generator=torch.Generator().manual_seed(1))
    for i in range(1, len(noise)):
        noise[i] = 0.4 * noise[i] + 0.6 * noise[i - 1]
    kept = [0, 1, 2, 3, 4, 7, 8, 9, 10, 11]
    found = ts.track((made + noise)[kept], (60.0, 60.0, 25.0), log=False).findings
    assert found.noise_memory > 0.3
    assert found.missing_frames == ((5, 2),)


def test_the_sentences_of_a_track_are_in_the_order_of_their_levels(track: ts.Track) -> None:
    levels = [LEVELS.index(level_of(sentence)) for sentence in track.warnings]
    assert levels == sorted(levels)
