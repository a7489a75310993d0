"""A ball close to a wide-angle lens: ``python -m experiments.validation.wide_angle RECORDING TRUTH``.

Claim: the model `pinhole` with the focal length of the field of view follows the ball to the end, without a learned
map.

RECORDING and TRUTH are 3axis0.avi and 3axis0_gt.csv of FicTrac's history (R. J. D. Moore et al., CC BY-NC-SA 3.0): 100
rendered frames, 13.5 deg per frame about changing axes, field of view 120 deg, the ball 2.9 radii from the camera. No
orthographic model holds there: the camera sees a cap of 69 deg instead of a hemisphere. The experiment prints the
errors of the rotation per frame and of the orientation since the first frame, against the absolute rotation vectors of
TRUTH.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import torch
from kornia.geometry.liegroup import So3

import torchsphere as ts
from experiments.experiment import Array

#: Field of view, and least standard deviation over time of a pixel on the ball, grey levels.
FIELD_OF_VIEW, MOVING = math.radians(120.0), 6.0


def outline_of(images: Array) -> ts.Circle:
    """The circle of a ball that turns in place, by area and centroid of the pixels that change over time."""
    moving = images.std(0) > MOVING
    y, x = np.nonzero(moving)
    return ts.Circle(float(x.mean()), float(y.mean()), math.sqrt(len(x) / math.pi))


def errors(track: ts.Track, truth: Array) -> tuple[Array, Array]:
    """Angle of the error of increments (n - 1,) and of orientations since the first frame (n,), deg."""
    true = So3.exp(torch.from_numpy(truth)).matrix()
    steps = (true[1:] @ true[:-1].mT).numpy()
    found = So3.exp(torch.from_numpy(np.nan_to_num(track.increment[:, 2:]))).matrix().numpy()
    measured = np.isfinite(track.increment[:, 2])
    of_steps = np.where(measured, _angle(found, steps), np.nan)
    path = [np.eye(3)]
    for step in steps:
        path.append(step @ path[-1])
    return of_steps, _angle(track.orientation, np.stack(path))


def _angle(a: Array, b: Array) -> Array:
    cosine = (np.einsum("nij,nij->n", a, b) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def main() -> None:
    """Track the recording and print its errors."""
    if len(sys.argv) != 3:
        raise SystemExit("give the recording and its table of true rotation vectors")
    recording = ts.open_recording(Path(sys.argv[1]))
    truth = np.loadtxt(sys.argv[2], delimiter=",")
    images = np.asarray(recording.images(0, len(recording)), dtype=float)
    focal = images.shape[2] / 2 / math.tan(FIELD_OF_VIEW / 2)
    circle = outline_of(images)
    print(f"outline {circle.x:.2f}, {circle.y:.2f}, {circle.radius:.2f} px")
    camera = ts.Camera(focal_px=focal)
    track = ts.track(recording, (circle.x, circle.y, circle.radius), model="pinhole", camera=camera, in_place=True)
    of_steps, of_path = errors(track, truth[: len(images)])
    ok = int((track.status == "ok").sum())
    print(f"{ok} of {len(images)} frames ok; truth turns by {np.degrees(np.linalg.norm(truth, axis=1)).max():.0f} deg")
    # The first step does not count: the first row of the truth is zero, not the orientation in the first image.
    print(f"step: median {np.nanmedian(of_steps[1:]):.2f}, worst {np.nanmax(of_steps[1:]):.2f} deg")
    known = np.isfinite(of_path)
    print(f"orientation: at the end {of_path[known][-1]:.1f} deg, worst {of_path[known].max():.1f} deg")


if __name__ == "__main__":
    main()
