"""The pinhole models on images of an independent renderer: perspective, distortion, motion in depth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from rendering import needs_mitsuba

import torchsphere as ts
from render.camera import Camera
from render.frames import render_frames
from render.pattern import Pattern
from render.pose import Poses
from render.scene import Quality, Setup
from render.sensor import Sensor
from torchsphere.dynamics.depth_plane import in_depth_plane

Array = NDArray[np.float64]

RADIUS, RADIUS_M = 40.0, 0.015


@dataclass(frozen=True)
class RenderedBall:
    """A rendered ball and its truth: projected centres (n, 2), radii (n,) at their depth, increments (n - 1, 5)."""

    images: NDArray[np.uint8]
    centres: Array
    radii: Array
    increments: Array
    camera: ts.Camera

    @property
    def circle(self) -> ts.Circle:
        return ts.Circle(*self.centres[0].tolist(), float(self.radii[0]))


def rendered_ball(
    *,
    distance: float = 10.0,
    n: int = 12,
    step: tuple[float, float] = (9.0, 2.0),
    turn_deg: tuple[float, float, float] = (0.1, 0.4, 0.2),
    nearer: float = 1.0,
    distortion: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> RenderedBall:
    """A ball that crosses the image, ``nearer`` times as large from frame to frame; 8 bit, noise 2 grey levels."""
    focal = RADIUS * distance
    camera = Camera("pinhole", width=240, height=140, focal_px=focal, distortion=distortion)
    rng = np.random.default_rng(1)
    # Projected centre without distortion, with random sub-pixel parts.
    straight = np.array([60.0, 55.0]) + np.arange(n)[:, None] * step + rng.uniform(-0.3, 0.3, (n, 2))
    depth = distance * RADIUS_M / nearer ** np.arange(n)
    position = np.column_stack(((straight - np.array(camera.centre_px)) / focal * depth[:, None], depth))
    turns = np.outer(np.arange(n), np.radians(turn_deg))
    orientation = So3.exp(torch.from_numpy(turns)).matrix().numpy()

    def motion(times_s: Array) -> Poses:
        frames = np.round(times_s).astype(int)
        return Poses(position[frames], orientation[frames])

    setup = Setup(
        pattern=Pattern(speckle_mm=1.5, seed=3),
        camera=camera,
        sensor=Sensor(read_noise_grey=2.0),
        quality=Quality(samples=64),
    )
    images = np.stack(list(render_frames(setup, motion, np.arange(n, dtype=float))))
    centres = camera.project(position)
    increments = np.column_stack((np.diff(centres, axis=0), np.tile(np.radians(turn_deg), (n - 1, 1))))
    return RenderedBall(images, centres, focal * RADIUS_M / depth, increments, ts.Camera(focal, distortion=distortion))


def errors(track: ts.Track, truth: RenderedBall) -> Array:
    """Errors (n - 1, 5) of the increments, px and deg."""
    assert (track.status == "ok").all()
    off = track.increment - truth.increments
    return np.concatenate((off[:, :2], np.degrees(off[:, 2:])), 1)


def in_stated(track: ts.Track, truth: RenderedBall) -> Array:
    """Errors (n - 1, 5) of the increments over their stated standard deviations."""
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    return (track.increment - truth.increments) / sd


# Eleven pairs with standard deviations of 0.006 px and 0.012 deg: 0.004 px and 0.008 deg are two standard errors of an
# uncorrelated mean. The model `rigid` errs by 0.5 deg here.
@needs_mitsuba
@pytest.mark.parametrize("distortion", [(0.0, 0.0, 0.0), (-0.15, 0.02, 0.0)])
def test_a_ball_that_crosses_a_near_camera_is_measured_without_bias(distortion: tuple[float, float, float]) -> None:
    truth = rendered_ball(distortion=distortion)
    track = ts.track(truth.images, truth.circle, model="pinhole", camera=truth.camera)
    bias = np.abs(errors(track, truth).mean(0))
    assert (bias[:2] < 0.004).all()
    assert (bias[2:] < 0.008).all()
    assert np.abs(in_stated(track, truth)).max() < 4.5
    orthographic = ts.track(truth.images, truth.circle, sphere_map=False)
    assert np.abs(errors(orthographic, truth).mean(0))[3] > 0.3


@needs_mitsuba
def test_the_ball_and_the_focal_length_of_the_camera_are_found() -> None:
    truth = rendered_ball()
    by_distance = ts.Camera(distance_radii=10.0)
    track = ts.track(truth.images, model="pinhole", camera=by_distance)
    # The outline gives a radius of 40 px to 0.3 px, with the bias of the centre beside the optical axis.
    assert track.circle.radius == pytest.approx(RADIUS, abs=0.3)
    np.testing.assert_allclose([track.circle.x, track.circle.y], truth.centres[0], atol=0.3)
    # The focal length follows from the size of the outline: 0.3 of 40 px.
    assert track.settings["camera"]["focal_px"] == pytest.approx(truth.camera.focal_px, rel=0.01)
    # An error of 0.3 px of the radius moves a step by 0.01 px at 0.5 deg.
    assert np.abs(errors(track, truth).mean(0)[:2]).max() < 0.015


@needs_mitsuba
def test_motion_along_the_optical_axis_is_measured_and_biases_no_other_component() -> None:
    truth = rendered_ball(nearer=1.004)
    track = ts.track(truth.images, truth.circle, model="pinhole6", camera=truth.camera)
    bias = np.abs(errors(track, truth).mean(0))
    assert (bias[:2] < 0.004).all()
    assert (bias[2:] < 0.008).all()
    # 1e-4 of the radius per step, with errors that cancel; 4.5 standard deviations of the last radius.
    assert np.abs(track.radius - truth.radii).max() < 4.5 * RADIUS * float(np.nanmax(track.sd_growth)) * np.sqrt(2)
    growth = np.diff(track.radius) / track.radius[:-1]
    assert np.abs((growth - 0.004) / track.sd_growth).max() < 4.5
    # In the plane of the first depth the velocity is constant.
    level = in_depth_plane(track)
    straight = np.diff((truth.centres - 119.5 * np.array([1, 0])) / truth.radii[:, None] * RADIUS, axis=0)
    np.testing.assert_allclose(level.increment[:, 0], straight[:, 0], atol=0.05)


@needs_mitsuba
def test_a_ball_that_approaches_at_a_constant_sideways_velocity_has_this_velocity() -> None:
    truth = rendered_ball(nearer=1.004)
    track = ts.track(truth.images, truth.circle, model="pinhole6", camera=truth.camera)
    motion = ts.kinematics(track, frame_rate=1000.0, diameter_m=2 * RADIUS_M, method="differences")
    m_per_px = RADIUS_M / truth.radii
    true = np.diff((truth.centres[:, 0] - 119.5) * m_per_px)
    found = np.diff(motion.position_m[:, 0])
    # 0.02 px of 40 px per 15 mm; the scale of the first frame for all frames would err by 4 % of 3.4 mm at the end.
    np.testing.assert_allclose(found, true, atol=8e-6)


@needs_mitsuba
def test_the_uncertain_depth_enters_the_position_beside_the_axis() -> None:
    truth = rendered_ball(nearer=1.004, n=6)
    track = ts.track(truth.images, truth.circle, model="pinhole6", camera=truth.camera)
    level = in_depth_plane(track)
    beside = truth.centres[1:, 0] - 119.5
    # The distance of the ball from the optical axis adds this; the rest is that of the step, at a scale of nearly 1.
    added = (beside * track.sd_growth) ** 2
    np.testing.assert_allclose(level.covariance[:, 0, 0], track.covariance[:, 0, 0] + added, rtol=0.06)


def test_without_a_camera_a_track_is_not_scaled_to_a_plane() -> None:
    images = np.random.default_rng(0).integers(0, 255, (2, 60, 60)).astype(np.float32)
    track = ts.track(images, (30.0, 30.0, 20.0))
    assert in_depth_plane(track) is track


def test_a_track_by_the_pinhole_model_without_distortion_is_already_in_its_plane() -> None:
    images = np.random.default_rng(0).integers(0, 255, (2, 60, 60)).astype(np.float32)
    track = ts.track(np.stack((images[0], images[0])), (30.0, 30.0, 20.0), model="pinhole", camera=ts.Camera(500.0))
    level = in_depth_plane(track)
    assert dataclasses.replace(level, position=track.position).status is track.status
    np.testing.assert_allclose(level.position, track.position, atol=1e-9)
    np.testing.assert_allclose(level.increment, track.increment, atol=1e-6)
