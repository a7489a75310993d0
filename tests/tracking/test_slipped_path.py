"""A path beside the ball is moved to its limbs, and its steps are measured again."""

import dataclasses

import numpy as np
import torch
from shots import noisy, rotation_matrix

from torchsphere.correlation.options import Options
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.synthetic import ray_caster
from torchsphere.tracking import slipped_path
from torchsphere.tracking.follow import Follower
from torchsphere.tracking.start import Start
from torchsphere.tracking.task import Task

FRAMES, RADIUS, STEP, TURN = 12, 28.0, np.array([2.0, 0.5]), np.radians([1.5, -1.0, 0.5])


def film() -> tuple[Source, np.ndarray]:
    """Images of a ball, and its centres (n, 2)."""
    centres = np.array([45.0, 48.0]) + np.arange(FRAMES)[:, None] * STEP
    turned = torch.stack([rotation_matrix(torch.from_numpy(i * TURN)) for i in range(FRAMES)]).float()
    images = ray_caster.render(
        ray_caster.speckle(4, radius_px=RADIUS),
        torch.from_numpy(centres).float(),
        RADIUS,
        turned,
        100.0,
        shape=(104, 120),
    )
    return Source.open(noisy(images, 2.0, 3)), centres


def begun(source: Source, centres: np.ndarray) -> tuple[Task, Start]:
    start = Start(Circle(*centres[0], RADIUS), source.images(0, 1)[0], 0.0, Options())
    return Task(source, None, None, False, False, False, None, None, None), start


def test_a_path_that_slips_is_found_and_moved_to_the_limbs() -> None:
    source, centres = film()
    task, start = begun(source, centres)
    measured = Follower(source, start.circle, None, start.options).run(FRAMES)
    assert (measured.status == "ok").all()
    assert not slipped_path.have_slipped(slipped_path.limbs_along(task, start, measured))

    slip = np.arange(FRAMES)[:, None] * np.array([0.35, -0.25])
    slipped = dataclasses.replace(measured, position=measured.position + slip)
    limbs = slipped_path.limbs_along(task, start, slipped)
    assert slipped_path.have_slipped(limbs)
    # The slip is 0.43 px per frame: from frame 2 on, limbs tell it from their own errors.
    assert 1 <= slipped_path.slipped_from(limbs) <= 4
    held = slipped_path.along_limbs(task, start, slipped, limbs, resized=False)
    assert np.abs(held.position - centres).max() < 0.4
    sd = np.sqrt(np.diagonal(held.covariance, axis1=1, axis2=2))
    assert (np.abs(held.increment - np.array([*STEP, *TURN])) < 6 * sd).all()
    assert np.array_equal(held.rotation[1:], held.increment[:, 2:])
    assert np.array_equal(held.size, measured.size)


def test_frames_that_no_map_shows_are_told_from_the_ball_by_their_limbs() -> None:
    source, centres = film()
    measured = Follower(source, Circle(*centres[0], RADIUS), None, Options()).run(FRAMES)
    limbs = slipped_path.limbs_along(*begun(source, centres), measured)
    # Frames 2 and 3 lie on the ball; frames 6 to 9 lie 3 px beside it, and 10 and 11 are on the map.
    unproven = np.isin(np.arange(FRAMES), (2, 3, 6, 7, 8, 9))
    position = measured.position + 3.0 * (np.arange(FRAMES) >= 6)[:, None]
    assert np.flatnonzero(slipped_path.runs_beside(limbs, position, unproven)).tolist() == [6, 7, 8, 9]
    assert not slipped_path.runs_beside(limbs, measured.position, unproven).any()
    assert not slipped_path.runs_beside(limbs, position, np.zeros(FRAMES, dtype=bool)).any()


def test_a_record_without_frames_has_no_steps_to_and_from_them() -> None:
    source, centres = film()
    measured = Follower(source, Circle(*centres[0], RADIUS), None, Options()).run(FRAMES)
    kept = measured.without(slice(8, None))
    assert (kept.status[:8] == "ok").all()
    assert (kept.status[8:] == "lost").all()
    assert np.isnan(kept.position[8:]).all()
    assert np.isnan(kept.increment[7:]).all()
    assert np.isnan(kept.covariance[7:]).all()
    assert np.isfinite(kept.increment[:7]).all()
    assert (measured.status == "ok").all()
