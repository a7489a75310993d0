"""A ball that turns in its place: recognised, held in one position, and told from balls that roll, bounce or fly."""

import functools

import numpy as np
import pytest
import shots
import torch

import torchsphere as ts
from torchsphere.synthetic import ray_caster

N, RADIUS, PLACE, SHAPE = 30, 30.0, (48.3, 41.6), (84, 100)

#: A given circle with a radius 4 % too large.
TOO_LARGE = (*PLACE, 1.04 * RADIUS)


def film(turn_deg: tuple[float, float, float], path: np.ndarray | None = None) -> tuple[np.ndarray, torch.Tensor]:
    """Images (n, h, w) of a ball that turns by so much per frame on a ``path`` (n, 2), and its orientations."""
    turn = torch.deg2rad(torch.tensor(turn_deg, dtype=torch.float64))
    orientations = torch.stack([shots.rotation_matrix(turn * i) for i in range(N)])
    centres = torch.tensor(PLACE).expand(N, 2) + (0 if path is None else torch.from_numpy(path).float())
    pattern = shots.speckle(2, RADIUS)
    clean = ray_caster.render(pattern, centres, RADIUS, orientations.float(), 60.0, shape=SHAPE)
    return shots.noisy(clean, 2.0, 5).numpy().astype(np.uint8), orientations


def angle_deg(track: ts.Track, orientations: torch.Tensor) -> float:
    """Largest error of the orientation, deg."""
    relative = track.orientation @ orientations.numpy().swapaxes(1, 2)
    cosine = (np.trace(relative, axis1=1, axis2=2) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(np.nanmin(cosine), -1, 1))))


@functools.cache
def with_a_wrong_radius() -> tuple[ts.Track, torch.Tensor]:
    """The track by pairs of a ball in its place, and its orientations."""
    images, orientations = film((1.0, 2.0, 0.5))
    return ts.track(images, TOO_LARGE, sphere_map=False), orientations


def test_a_ball_turning_in_place_with_a_wrong_radius_is_recognised_and_held() -> None:
    track, orientations = with_a_wrong_radius()
    assert track.settings["in_place"]
    assert any("turns without leaving its place" in said for said in track.warnings)
    assert any("show a radius of" in said for said in track.warnings)
    known = track.position[np.isfinite(track.position[:, 0])]
    assert len(known) > 0.9 * N
    assert np.ptp(known, axis=0).max() == 0
    # Limbs give the place to 0.1 px.
    assert np.abs(known[0] - PLACE).max() < 0.15
    assert abs(track.circle.radius - RADIUS) < 0.15
    assert angle_deg(track, orientations) < 0.8
    steps = track.increment[np.isfinite(track.increment[:, 0])]
    assert np.abs(steps[:, :2]).max() == 0
    assert (np.linalg.eigvalsh(track.covariance[np.isfinite(track.covariance).all((1, 2))]) > 0).all()


def test_a_map_corrects_the_wrong_radius_of_a_ball_in_its_place() -> None:
    images, orientations = film((1.0, 2.0, 0.5))
    track = ts.track(images, TOO_LARGE)
    assert track.findings.is_on_map
    assert (track.status == "ok").all()
    assert np.abs(track.position - PLACE).max() < 0.04
    assert abs(track.circle.radius - RADIUS) < 0.02
    assert angle_deg(track, orientations) < 0.06


def test_a_ball_said_to_be_in_place_is_measured_alike() -> None:
    images, _ = film((1.0, 2.0, 0.5))
    said = ts.track(images, TOO_LARGE, sphere_map=False, in_place=True)
    alone, _ = with_a_wrong_radius()
    assert np.array_equal(said.position, alone.position, equal_nan=True)
    assert not any("turns without leaving its place" in sentence for sentence in said.warnings)


ALONG = np.linspace(0, 1, N)[:, None]
MOTIONS = {
    "slow roll": ((0.0, -0.5, 0.0), ALONG * [np.radians(0.5) * RADIUS * (N - 1), 0]),
    "slow flight": ((1.0, 2.0, 0.5), ALONG * [0.9, -0.6]),
    "bounce": ((0.0, 2.0, 0.5), -3.0 * np.abs(2 * ALONG - 1) * [0, 1]),
    "swing": ((1.0, 2.0, 0.0), 0.8 * np.sin(4 * np.pi * ALONG) * [1, 0]),
    "at rest": ((0.0, 0.0, 0.0), 0 * ALONG * [1, 1]),
}


@pytest.mark.parametrize("radius", [RADIUS, 1.04 * RADIUS])
@pytest.mark.parametrize("name", MOTIONS)
def test_a_ball_that_leaves_its_place_is_never_held(name: str, radius: float) -> None:
    turn, path = MOTIONS[name]
    images, _ = film(turn, path)
    track = ts.track(images, (*(np.array(PLACE) + path[0]), radius), sphere_map=False)
    assert not track.settings["in_place"]
    assert (track.status == "ok").mean() > 0.8


def test_steps_against_the_place_are_a_warning_with_their_causes() -> None:
    images, _ = film((1.0, 2.0, 0.5))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    # The limb is hidden, so that nothing shows the wrong radius but the steps.
    hidden = np.hypot(x - PLACE[0], y - PLACE[1]) > 0.85 * RADIUS
    track = ts.track(images, TOO_LARGE, sphere_map=False, in_place=True, ignore=hidden)
    (said,) = (sentence for sentence in track.warnings if "held in its place against steps" in sentence)
    assert "a wrong radius (here 31.20 px)" in said
    right = ts.track(images, (*PLACE, RADIUS), sphere_map=False, in_place=True)
    assert not any("held in its place against steps" in sentence for sentence in right.warnings)


def test_a_flying_ball_said_to_be_in_place_is_a_warning() -> None:
    images, _ = film((0.0, 1.0, 0.0), ALONG * [6.0, 0.0])
    track = ts.track(images, (*PLACE, RADIUS), sphere_map=False, in_place=True)
    assert any("its outline moves" in said or "held in its place against steps" in said for said in track.warnings)


def test_frames_without_the_ball_do_not_end_the_rest() -> None:
    images, orientations = film((3.0, 9.0, 0.0))
    images[8:16] = 60
    track = ts.track(images, (*PLACE, RADIUS), sphere_map=False, in_place=True)
    # The side that the ball shows after the gap was never seen: its orientation stays unknown, its steps do not.
    assert (track.status[20:] == "ok").mean() > 0.8
    turn = np.array([3.0, 9.0, 0.0])
    assert np.nanmax(np.abs(np.degrees(track.increment[20:, 2:]) - turn)) < 0.5
    assert np.isnan(track.position[8:16]).all()
    assert angle_deg(track, orientations) < 1.0


def test_no_contact_is_sought_in_a_ball_in_its_place() -> None:
    images, _ = film((1.0, 2.0, 0.5))
    motion = ts.kinematics(
        ts.track(images, (*PLACE, RADIUS), sphere_map=False, in_place=True), frame_rate=1e3, diameter_m=0.03
    )
    assert motion.contact_s is None
    assert np.abs(motion.velocity_m_s).max() < 1e-9
    assert (motion.sd_velocity_m_s > 0).all()
    assert np.abs(np.degrees(motion.spin_rad_s).mean(0) / 1e3 - [1.0, 2.0, 0.5]).max() < 0.05
    assert ts.impact(motion) == (None, "The ball stays in its place, so no contact was sought.")
