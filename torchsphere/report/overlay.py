"""``overlay.mp4``: the images of a result with circle, path and axes of the ball, and the numbers of each frame."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from torchsphere.correlation.frame_status import ALL_KNOWN, TRANSLATION_KNOWN
from torchsphere.geometry.orientation import matrices
from torchsphere.recording.refusal import LibraryMissingError
from torchsphere.report.image_figures import kept_images
from torchsphere.results.atomic_output import atomic_path
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import Sampled
from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:
    from PIL.Image import Image

#: Least length of the video's longer side, px, for readable text; frames per second; H.264's constant rate factor.
SIDE_PX, FRAMES_PER_S, RATE_FACTOR = 720, 25, "20"

#: Colours of Okabe and Ito for the circle, the path and the axes x, y, z of the ball.
CIRCLE, PATH, AXES = "#E69F00", "#56B4E9", ("#D55E00", "#009E73", "#CC79A7")

#: Length of the axes, radii, and height of a line of text, px.
AXIS_LENGTH, LINE_PX = 0.9, 28


@dataclass(frozen=True)
class Arrow:
    """An axis of the ball with its ``tip`` (2,), px of the recording, before or behind the image plane."""

    name: str
    tip: Array
    in_front: bool


def ball_axes(centre: Array, radius: float, orientation: Array) -> list[Arrow]:
    """Axes of the ball at an orientation (3, 3) since the first frame, in which they are those of the camera.

    The list is empty if the orientation is NaN.
    """
    if not np.isfinite(orientation).all():
        return []
    tips = AXIS_LENGTH * radius * orientation
    return [Arrow(name, centre + tips[:2, k], bool(tips[2, k] <= 1e-9)) for k, name in enumerate("xyz")]


def check_library() -> None:
    """Raise LibraryMissingError unless PyAV is installed."""
    if importlib.util.find_spec("av") is None:
        raise LibraryMissingError("an overlay video needs PyAV: pip install 'torchsphere[video]'")


def write_overlay(result: ResultFolder) -> Path:
    """Write ``overlay.mp4`` into the result folder, from the images in this folder, and return its path.

    The video is H.264 with 4:2:0 colours, which browsers play. The file appears whole or not at all. Raises ValueError
    if the result keeps no images, and LibraryMissingError if PyAV is not installed.
    """
    sampled = kept_images(result)
    check_library()
    import av

    path, options = result.path / "overlay.mp4", {"movflags": "+faststart"}
    with atomic_path(path) as new, av.open(str(new), "w", format="mp4", options=options) as container:
        stream: Any = container.add_stream("libx264", rate=FRAMES_PER_S, options={"crf": RATE_FACTOR})
        stream.pix_fmt = "yuv420p"
        stream.width, stream.height = draw_frame(result, sampled, 0).size
        for k in range(len(sampled.row)):
            picture = np.asarray(draw_frame(result, sampled, k))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return path


def draw_frame(result: ResultFolder, sampled: Sampled, k: int) -> Image:
    """Frame ``k`` of the video; its sides are even numbers, as 4:2:0 colours need."""
    from PIL import Image, ImageDraw

    left, top, width, height = sampled.box
    zoom = max(SIDE_PX / max(width, height), 1.0)
    size = 2 * round(zoom * width / 2), 2 * round(zoom * height / 2)
    image = sampled.image(k).convert("RGB").resize(size, Image.Resampling.BICUBIC)
    picture = Image.new("RGB", (max(size[0], SIDE_PX), size[1] + 2 * LINE_PX), "black")
    picture.paste(image, (0, 2 * LINE_PX))
    draw = ImageDraw.Draw(picture)

    def pixel(point: Array) -> tuple[float, float]:
        x, y = (point - (left, top)) * (size[0] / width, size[1] / height)
        return float(x), float(y) + 2 * LINE_PX

    row = int(sampled.row[k])
    before = result.position[: row + 1]
    for part in np.split(before, np.flatnonzero(~np.isfinite(before[:, 0]))):
        line = [pixel(p) for p in part if np.isfinite(p).all()]
        if len(line) > 1:
            draw.line(line, fill=PATH, width=2)
    if result.known[row]:
        centre, radius = result.position[row], float(result.radius[row])
        draw.ellipse((*pixel(centre - radius), *pixel(centre + radius)), outline=CIRCLE, width=2)
        for arrow in ball_axes(centre, radius, matrices(result.quaternion[row : row + 1])[0]):
            _arrow(draw, pixel(centre), pixel(arrow.tip), arrow, AXES["xyz".index(arrow.name)])
    _text(draw, result, row)
    return picture


def _arrow(draw: Any, start: tuple[float, float], tip: tuple[float, float], arrow: Arrow, colour: str) -> None:
    """A line to a dot with the letter of the axis; thin and hollow if the axis points away from the camera."""
    draw.line((start, tip), fill=colour, width=4 if arrow.in_front else 1)
    dot = (tip[0] - 5, tip[1] - 5, tip[0] + 5, tip[1] + 5)
    draw.ellipse(dot, fill=colour if arrow.in_front else "black", outline=colour, width=2)
    # White, because a letter in the colour of the axis cannot be read on the pattern.
    draw.text((tip[0] + 8, tip[1] - 10), arrow.name, fill="white", font=_font(20), stroke_width=2, stroke_fill="black")


def _text(draw: Any, result: ResultFolder, row: int) -> None:
    """Two lines above the image: the numbers of the frame, and the axes with the frame's status."""
    motion, status = result.motion, str(result.status[row])
    parts = [f"frame {result.frame[row]}"]
    if np.isfinite(result.time_s[row]):
        parts.append(f"{1e3 * result.time_s[row]:.3f} ms")
    if motion is not None and np.isfinite(motion.velocity_m_s[row]).all():
        parts.append(f"v = ({motion.velocity_m_s[row, 0]:.2f}, {motion.velocity_m_s[row, 1]:.2f}) m/s")
    if motion is not None and np.isfinite(motion.spin_rad_s[row]).all():
        parts.append(f"{np.linalg.norm(motion.spin_rad_s[row]) / (2 * np.pi):.1f} rev/s")
    draw.text((8, 4), "   ".join(parts), fill="white", font=_font(18))
    axes = "lab frame" if result.lab_frame else "camera frame"
    measured = TRANSLATION_KNOWN if result.without_rotation else ALL_KNOWN
    remark = "" if status in measured else f"not fully measured: {status.replace('_', ' ')}"
    draw.text((8, LINE_PX + 4), f"{axes}; axes x, y, z move with the ball   {remark}", fill="#BBBBBB", font=_font(15))


def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)
