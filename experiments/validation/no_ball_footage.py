"""Recordings that show no ball, for `experiments.validation.no_ball`: each is made from a seed.

A `Scene` is a larger picture that a camera looks at through a window, still or held by hand; things that move, light
that changes and what cameras and codecs do are added to it.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from experiments.experiment import Array
from experiments.validation.attack_footage import blotches, digitised, h264
from torchsphere.imaging.interpolation import blur
from torchsphere.synthetic import ray_caster

#: Pixels of the scene around the camera's window, for a camera that is held by hand.
AROUND_PX = 40

#: Makes a recording (n, h, w), whole grey levels of 8 bits, from a seed.
Empty = Callable[[int], Tensor]


@dataclass(frozen=True)
class View:
    """Size of a recording."""

    frames: int
    height: int
    width: int

    @property
    def scene(self) -> tuple[int, int]:
        """Height and width of the scene that the camera may see, px."""
        return self.height + 2 * AROUND_PX, self.width + 2 * AROUND_PX

    @property
    def times(self) -> Tensor:
        """Numbers (n, 1, 1) of the frames."""
        return torch.arange(self.frames)[:, None, None]


def grid(shape: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Rows (h, 1) and columns (1, w) of an image."""
    return torch.arange(shape[0])[:, None].float(), torch.arange(shape[1])[None].float()


def smooth(view: View, seed: int, *, spread: float = 25.0) -> Tensor:
    """A smooth wall (h, w) of the scene's size: light that falls off to the sides, and hardly any texture."""
    rng = np.random.default_rng(seed)
    rows, columns = grid(view.scene)
    y, x = rows / view.scene[0] - rng.uniform(0.2, 0.8), columns / view.scene[1] - rng.uniform(0.2, 0.8)
    return (
        140
        + rng.uniform(-0.5, 0.5) * spread * x
        - 2 * spread * (x**2 + y**2)
        + 0.1 * (blotches(view.scene, seed) - 120)
    )


def walk(view: View, seed: int, px: float) -> Array:
    """Path (n, 2), px, of a camera that a hand moves by about ``px`` per frame, up to `AROUND_PX` to all sides."""
    rng = np.random.default_rng(seed)
    phase, period = rng.uniform(0, 2 * math.pi, (2, 3)), np.array([43.0, 17.0, 7.0])
    turn = 2 * math.pi * np.arange(view.frames)[:, None, None] / period + phase
    sway = (np.sin(turn) * period / (2 * math.pi)).sum(-1) * px
    return np.asarray(np.clip(sway - sway[:1], 4 - AROUND_PX, AROUND_PX - 4))


def looked_up(picture: Tensor, columns: Tensor, rows: Tensor) -> Tensor:
    """The picture at the places (h, w), px."""
    x, y = torch.broadcast_tensors(columns, rows)
    height, width = picture.shape
    grid = torch.stack((2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1), -1)
    found = F.grid_sample(picture[None, None], grid[None].to(picture), mode="bicubic", align_corners=True)
    return found[0, 0]


def seen(scene: Tensor, view: View, path: Array) -> Tensor:
    """The window (n, h, w) of a camera on a ``path`` (n, 2), px."""
    rows, columns = grid((view.height, view.width))
    return torch.stack([looked_up(scene, columns + AROUND_PX + x, rows + AROUND_PX + y) for x, y in path.tolist()])


def by_hand(scene: Tensor, view: View, seed: int, px: float) -> Tensor:
    """The scene seen by a camera that is held by hand."""
    return seen(scene, view, walk(view, seed, px))


def still(scene: Tensor, view: View) -> Tensor:
    """The scene seen by a camera at rest."""
    window = scene[AROUND_PX : AROUND_PX + view.height, AROUND_PX : AROUND_PX + view.width]
    return window.expand(view.frames, -1, -1).clone()


def box(scene: Tensor, size: tuple[float, float], level: float, at: tuple[float, float] = (0.5, 0.5)) -> Tensor:
    """The scene with a box of ``size`` (h, w), px, whose middle is ``at`` these shares of its height and width."""
    rows, columns = grid(tuple(scene.shape))
    y, x = (rows - at[0] * scene.shape[0]).abs(), (columns - at[1] * scene.shape[1]).abs()
    cover = (size[0] / 2 - y + 0.5).clamp(0, 1) * (size[1] / 2 - x + 0.5).clamp(0, 1)
    return scene * (1 - cover) + level * cover


def disc(scene: Tensor, radius: float, look: Tensor | float, at: tuple[float, float] = (0.5, 0.5)) -> Tensor:
    """The scene with a flat disc of a ``look``, a grey level or a picture of the scene's size."""
    rows, columns = grid(tuple(scene.shape))
    distance = (rows - at[0] * scene.shape[0]).hypot(columns - at[1] * scene.shape[1])
    cover = (radius - distance + 0.5).clamp(0, 1)
    return scene * (1 - cover) + look * cover


def mjpeg(images: Tensor, quality: int) -> Tensor:
    """The images after JPEG of that quality."""
    from PIL import Image

    coded = []
    for image in images.to(torch.uint8).numpy():
        stream = io.BytesIO()
        Image.fromarray(image).save(stream, "JPEG", quality=quality)
        coded.append(np.asarray(Image.open(stream)))
    return torch.from_numpy(np.stack(coded)).float()


def soft_blobs(view: View, seed: int, count: int, radius: float, aspect: float, edge: float, speed: float) -> Tensor:
    """Share (n, h, w) that ellipses of that size, with edges so wide, px, cover while they walk across the view."""
    rng = np.random.default_rng(seed)
    rows, columns = grid((view.height, view.width))
    cover = torch.zeros(view.frames, view.height, view.width)
    for _ in range(count):
        x, y = rng.uniform(0.1, 0.9, 2) * (view.width, view.height)
        heading, size = rng.uniform(0, 2 * math.pi), radius * rng.uniform(0.7, 1.3)
        u = columns - x - speed * math.cos(heading) * view.times
        v = (rows - y - speed * math.sin(heading) * view.times) / aspect
        cover = torch.maximum(cover, ((size - u.hypot(v)) / edge + 0.5).clamp(0, 1))
    return cover


def warped(picture: Tensor, view: View, seed: int, px: float, wave_px: float) -> Tensor:
    """The picture as cloth that waves by ``px``, with waves of that length."""
    rows, columns = grid((view.height, view.width))
    images = []
    for frame in range(view.frames):
        u = px * torch.sin(2 * math.pi * (columns / wave_px + 0.6 * rows / wave_px - frame / 11) + seed)
        v = px * torch.cos(2 * math.pi * (rows / wave_px - 0.4 * columns / wave_px + frame / 13))
        images.append(looked_up(picture, columns + AROUND_PX + u, rows + AROUND_PX + v))
    return torch.stack(images)


# ---- recordings -------------------------------------------------------------------------------------------------


def _filmed(images: Tensor, seed: int, noise: float = 2.0) -> Tensor:
    return digitised(images, seed, noise)


def smooth_wall(view: View, noise: float = 2.0) -> Empty:
    """A smooth wall before a camera at rest."""
    return lambda seed: _filmed(still(smooth(view, seed), view), seed, noise)


def smooth_wall_by_hand(view: View) -> Empty:
    """The same by hand: the light falls off with the wall."""
    return lambda seed: _filmed(by_hand(smooth(view, seed), view, seed, 1.0), seed)


def light_switch(view: View, *, is_held: bool) -> Empty:
    """A light switch of 16 x 27 px on a smooth wall."""

    def make(seed: int) -> Tensor:
        scene = box(box(smooth(view, seed), (27, 16), 215.0), (9, 5), 190.0)
        return _filmed(by_hand(scene, view, seed, 1.0) if is_held else still(scene, view), seed)

    return make


def pan(view: View, size_px: float, px: float) -> Empty:
    """A camera held by hand before a texture."""
    return lambda seed: _filmed(by_hand(blotches(view.scene, seed, size_px), view, seed, px), seed)


def bricks(view: View) -> Empty:
    """A brick wall, by hand."""

    def make(seed: int) -> Tensor:
        rows, columns = grid(view.scene)
        course = (rows / 20).floor()
        joint = (rows % 20 < 3) | ((columns + 23 * (course % 2)) % 46 < 3)
        tone = 20 * torch.sin(course * 12.9 + ((columns + 23 * (course % 2)) / 46).floor() * 78.2)
        scene = blur(torch.where(joint, 170.0, 105.0 + tone)[None], 0.7)[0] + 0.2 * (blotches(view.scene, seed) - 120)
        return _filmed(by_hand(scene, view, seed, 1.5), seed)

    return make


def coded(make: Empty, code: Callable[[Tensor], Tensor]) -> Empty:
    """A recording after a codec."""
    return lambda seed: code(make(seed)).round()


def flicker(view: View) -> Empty:
    """Light of the mains on a smooth wall: bands that roll over the image, and a gain that changes."""

    def make(seed: int) -> Tensor:
        rows = grid((view.height, view.width))[0]
        gain = 1 + 0.12 * torch.sin(2 * math.pi * (rows / view.height + 0.13 * view.times)) * torch.sin(
            1.7 * view.times
        )
        return _filmed(still(smooth(view, seed), view) * gain, seed)

    return make


def fixed_pattern(view: View) -> Empty:
    """A dark image with the camera's own pattern: columns, spots of dust on the sensor and hot pixels."""

    def make(seed: int) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        pattern = (
            8
            + 1.5 * torch.randn(1, view.width, generator=generator)
            + 1.5 * torch.randn(view.height, view.width, generator=generator)
        )
        hot = torch.rand(view.height, view.width, generator=generator) > 0.999
        dust = blotches((view.height, view.width), seed, 9.0, 2.0) - 120
        return _filmed((pattern + dust + 90 * hot).expand(view.frames, -1, -1), seed)

    return make


def noise_alone(view: View, noise: float) -> Empty:
    """Nothing but noise."""
    return lambda seed: _filmed(torch.full((view.frames, view.height, view.width), 90.0), seed, noise)


def drifting_light(view: View, reach: float) -> Empty:
    """A soft spot of light that wanders over a smooth wall."""

    def make(seed: int) -> Tensor:
        rows, columns = grid((view.height, view.width))
        x = view.width * (0.5 + 0.3 * torch.sin(view.times / 19 + seed))
        y = view.height * (0.5 + 0.2 * torch.cos(view.times / 23))
        spot = 70 * torch.exp(-((columns - x).square() + (rows - y).square()) / (2 * reach**2))
        return _filmed(still(smooth(view, seed), view) + spot, seed)

    return make


def shadows(view: View, *, aspect: float = 2.5, edge: float = 12.0) -> Empty:
    """Shadows of people who walk by, soft."""

    def make(seed: int) -> Tensor:
        cover = soft_blobs(view, seed, 3, 0.12 * view.height, aspect, edge, 1.5)
        return _filmed(still(smooth(view, seed), view) * (1 - 0.4 * cover), seed)

    return make


def people(view: View) -> Empty:
    """People in clothes with texture who walk by, sharp: bodies 2.5 times as high as wide."""

    def make(seed: int) -> Tensor:
        cover = soft_blobs(view, seed, 3, 0.11 * view.height, 2.5, 1.5, 2.0)
        clothes = blotches((view.height, view.width + 2 * view.frames), seed + 1, 3.0)
        look = torch.stack([clothes[:, 2 * i : 2 * i + view.width] for i in range(view.frames)])
        return _filmed(still(blotches(view.scene, seed, 6.0, 20.0), view) * (1 - cover) + look * cover, seed)

    return make


def moving_box(view: View) -> Empty:
    """A box that is pushed across the image."""

    def make(seed: int) -> Tensor:
        side = 0.3 * view.height
        scene = still(smooth(view, seed), view)
        rows, columns = grid((view.height, view.width))
        middle = 0.25 * view.width + 0.5 * view.width * view.times / view.frames
        cover = (side / 2 - (rows - view.height / 2).abs() + 0.5).clamp(0, 1) * (
            side / 2 - (columns - middle).abs() + 0.5
        ).clamp(0, 1)
        return _filmed(scene * (1 - cover) + 60 * cover, seed)

    return make


def cloth(view: View, px: float, wave_px: float) -> Empty:
    """Printed cloth that waves in the wind."""
    return lambda seed: _filmed(warped(blotches(view.scene, seed, 4.0), view, seed, px, wave_px), seed)


def leaves(view: View) -> Empty:
    """Leaves that swing to and fro, each for itself."""

    def make(seed: int) -> Tensor:
        rng = np.random.default_rng(seed)
        rows, columns = grid((view.height, view.width))
        images = torch.full((view.frames, view.height, view.width), 80.0)
        for _ in range(60):
            x, y = rng.uniform(0, 1, 2) * (view.width, view.height)
            size, angle, level = rng.uniform(8, 22), rng.uniform(0, math.pi), rng.uniform(60, 190)
            swing = rng.uniform(1, 5) * torch.sin(view.times / rng.uniform(3, 9) + rng.uniform(0, 6))
            u = (columns - x - swing) * math.cos(angle) + (rows - y) * math.sin(angle)
            v = (rows - y) * math.cos(angle) - (columns - x - swing) * math.sin(angle)
            cover = (size * (1 - (u / size).hypot(2 * v / size)) + 0.5).clamp(0, 1)
            images = images * (1 - cover) + level * cover
        return _filmed(images, seed)

    return make


def screen(view: View) -> Empty:
    """A screen that is filmed: a picture in rows of pixels, with a dark band that rolls over it."""

    def make(seed: int) -> Tensor:
        rows, columns = grid((view.height, view.width))
        picture = blotches((view.height, view.width), seed, 8.0, 35.0)
        raster = 1 + 0.15 * torch.sin(2 * math.pi * rows / 3.3) * torch.sin(2 * math.pi * columns / 3.1)
        band = 1 - 0.4 * torch.exp(-(((rows - 7 * view.times) % view.height - view.height / 2) / 18).square())
        return _filmed(picture * raster * band, seed)

    return make


def scratches(view: View) -> Empty:
    """Old film: scratches, dust in other places in each image, and an image that jumps by a px."""

    def make(seed: int) -> Tensor:
        rng = np.random.default_rng(seed)
        images = seen(smooth(view, seed), view, rng.normal(0, 0.7, (view.frames, 2)))
        rows, columns = grid((view.height, view.width))
        for image in images:
            for _ in range(6):
                x, y, size = *rng.uniform(0, 1, 2) * (view.width, view.height), rng.uniform(1, 7)
                image[(rows - y).hypot((columns - x) * rng.uniform(0.6, 1.6)) < size] = rng.choice((20.0, 230.0))
            image[:, int(rng.uniform(0, view.width))] += 60
        return _filmed(images, seed)

    return make


def clock(view: View, *, is_held: bool) -> Empty:
    """A round clock on a wall: a face with marks; its hand ticks."""

    def make(seed: int) -> Tensor:
        rows, columns = grid(view.scene)
        y, x = rows - 0.5 * view.scene[0], columns - 0.5 * view.scene[1]
        radius, angle = 0.2 * view.height, torch.atan2(y, x)
        marks = ((angle * 6 / math.pi + 0.15).remainder(1) < 0.3) & (y.hypot(x) > 0.75 * radius)
        face = blur(torch.where(marks, 30.0, 225.0)[None], 0.7)[0]
        wall = blotches(view.scene, seed, 5.0, 8.0) if is_held else smooth(view, seed)
        one, path = View(1, view.height, view.width), walk(view, seed, 1.0 if is_held else 0.0)
        images = []
        for frame in range(view.frames):
            hand = math.radians(6.0 * (frame // 20))
            along, across = x * math.cos(hand) + y * math.sin(hand), y * math.cos(hand) - x * math.sin(hand)
            dial = torch.where((across.abs() < 2) & (along > 0) & (along < 0.7 * radius), 40.0, face)
            images.append(seen(disc(wall, radius, blur(dial[None], 0.6)[0]), one, path[frame : frame + 1]))
        return _filmed(torch.cat(images), seed)

    return make


def poster(view: View, radius: float, *, is_held: bool) -> Empty:
    """A poster of a speckled ball on a wall with texture."""

    def make(seed: int) -> Tensor:
        height, width = view.scene
        wall = blotches(view.scene, seed, 4.0, 10.0)
        centre = torch.tensor([[width / 2, height / 2]])
        scene = ray_caster.render(ray_caster.speckle(seed, radius_px=radius), centre, radius, torch.eye(3)[None], wall)[
            0
        ]
        return _filmed(by_hand(scene, view, seed, 1.0) if is_held else still(scene, view), seed)

    return make


def lamp(view: View, radius: float) -> Empty:
    """A round lamp on a dark wall, at rest."""
    return lambda seed: _filmed(still(disc(0.3 * smooth(view, seed), radius, 245.0), view), seed)


def snow(view: View) -> Empty:
    """Snow that falls."""

    def make(seed: int) -> Tensor:
        rng = np.random.default_rng(seed)
        images = still(0.5 * smooth(view, seed), view)
        rows, columns = grid((view.height, view.width))
        for _ in range(40):
            x, y, size = *rng.uniform(0, 1, 2) * (view.width, view.height), rng.uniform(1.0, 3.5)
            down, along = rng.uniform(2, 6), rng.uniform(-1.5, 1.5)
            u, v = columns - (x + along * view.times) % view.width, rows - (y + down * view.times) % view.height
            images = torch.maximum(images, 200 * (size - u.hypot(v) + 0.5).clamp(0, 1))
        return _filmed(images, seed)

    return make


def dust_cloud(view: View) -> Empty:
    """A cloud of dust that drifts and changes its shape."""

    def make(seed: int) -> Tensor:
        wide = (view.height, view.width + 3 * view.frames)
        near, far = blotches(wide, seed, 16.0), blotches(wide, seed + 1, 9.0)
        parts = [near[:, 3 * i : 3 * i + view.width] + far[:, i : i + view.width] for i in range(view.frames)]
        return _filmed(torch.stack(parts) / 2, seed)

    return make


def zoom(view: View, per_frame: float) -> Empty:
    """A zoom into a texture."""

    def make(seed: int) -> Tensor:
        picture = blotches(view.scene, seed, 4.0)
        rows, columns = grid((view.height, view.width))
        y, x = rows - view.height / 2, columns - view.width / 2
        sizes = [(1 + per_frame) ** -frame for frame in range(view.frames)]
        middle = view.scene[1] / 2, view.scene[0] / 2
        return _filmed(torch.stack([looked_up(picture, x * s + middle[0], y * s + middle[1]) for s in sizes]), seed)

    return make


def water(view: View) -> Empty:
    """Light on water: a net of bright lines that moves."""

    def make(seed: int) -> Tensor:
        rng = np.random.default_rng(seed)
        rows, columns = grid((view.height, view.width))
        total = torch.zeros(view.frames, view.height, view.width)
        for _ in range(6):
            length, heading, phase = rng.uniform(25, 70), rng.uniform(0, 2 * math.pi), rng.uniform(0, 6)
            along = (columns * math.cos(heading) + rows * math.sin(heading)) / length
            total = total + torch.sin(2 * math.pi * along + view.times / rng.uniform(2, 6) + phase)
        return _filmed(80 + 110 * torch.exp(-(total / 1.2).square()), seed)

    return make


_SMALL, _PHONE = View(24, 128, 192), View(60, 288, 384)

#: Recording without a ball by its name in the table.
CASES: dict[str, Empty] = {
    "noise of 2 levels": noise_alone(View(12, 128, 128), 2.0),
    "noise of 25 levels": noise_alone(View(24, 160, 240), 25.0),
    "smooth wall": smooth_wall(View(12, 120, 160)),
    "smooth wall, large": smooth_wall(View(30, 480, 848)),
    "smooth wall by hand": smooth_wall_by_hand(_PHONE),
    "smooth wall by hand, H.264": coded(smooth_wall_by_hand(View(133, 480, 848)), lambda v: h264(v, 28)),
    "smooth wall, MJPEG": coded(smooth_wall(_PHONE), lambda v: mjpeg(v, 50)),
    "light switch": light_switch(_PHONE, is_held=False),
    "light switch by hand": light_switch(_PHONE, is_held=True),
    "light switch by hand, H.264": coded(light_switch(View(60, 480, 848), is_held=True), lambda v: h264(v, 23)),
    "texture by hand, 1 px": pan(_PHONE, 3.0, 1.0),
    "texture by hand, 4 px": pan(_SMALL, 5.0, 4.0),
    "large texture by hand": pan(View(40, 240, 320), 14.0, 1.5),
    "texture by hand, H.264": coded(pan(_PHONE, 4.0, 1.0), lambda v: h264(v, 33)),
    "bricks by hand": bricks(_PHONE),
    "flicker": flicker(_PHONE),
    "fixed pattern": fixed_pattern(View(40, 200, 256)),
    "wandering spot of light": drifting_light(View(60, 200, 256), 30.0),
    "wandering large spot of light": drifting_light(View(40, 240, 320), 70.0),
    "shadows of people": shadows(_PHONE),
    "round soft shadows": shadows(View(40, 240, 320), aspect=1.0, edge=30.0),
    "people": people(_PHONE),
    "box that moves": moving_box(View(30, 200, 320)),
    "cloth": cloth(View(40, 240, 320), 3.0, 90.0),
    "cloth with short waves": cloth(_SMALL, 2.0, 45.0),
    "leaves": leaves(View(40, 240, 320)),
    "screen": screen(View(40, 240, 320)),
    "scratches": scratches(View(30, 240, 320)),
    "round clock": clock(View(60, 240, 320), is_held=False),
    "round clock by hand": clock(View(60, 240, 320), is_held=True),
    "poster of a ball": poster(View(24, 160, 240), 40.0, is_held=False),
    "poster of a ball by hand": poster(View(40, 240, 320), 50.0, is_held=True),
    "round lamp": lamp(View(30, 128, 192), 18.0),
    "snow": snow(View(60, 240, 320)),
    "cloud of dust": dust_cloud(View(40, 240, 320)),
    "zoom into a texture": zoom(View(30, 240, 320), 0.004),
    "light on water": water(View(40, 240, 320)),
}
