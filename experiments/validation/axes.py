"""Picture of axes and signs: ``python -m experiments.validation.axes``.

Each panel shows the ball after one positive component of an increment, and its outline before.
"""

from __future__ import annotations

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from matplotlib.axes import Axes

from experiments.experiment import BLUE, DOCS, VERMILION, saved_figure
from torchsphere.synthetic import ray_caster

RADIUS, SIZE, TURN, STEP = 50.0, 130, 0.45, 14.0
CENTRE = torch.tensor([[65.0, 65.0]])

PANELS = (
    ("+dx: right", (STEP, 0.0), (0.0, 0.0, 0.0), (STEP, 0.0)),
    ("+dy: down", (0.0, STEP), (0.0, 0.0, 0.0), (0.0, STEP)),
    ("+wx: the front moves down", (0.0, 0.0), (TURN, 0.0, 0.0), (0.0, 22.0)),
    ("+wy: the front moves left", (0.0, 0.0), (0.0, TURN, 0.0), (-22.0, 0.0)),
    ("+wz: clockwise", (0.0, 0.0), (0.0, 0.0, TURN), None),
)


def marks() -> ray_caster.Pattern:
    """A grey ball with one bright and one dark mark on its front, and a bright one at its upper limb."""
    steps = torch.linspace(-ray_caster.CUBE_HALF_WIDTH, ray_caster.CUBE_HALF_WIDTH, 128)
    z, y, x = torch.meshgrid(steps, steps, steps, indexing="ij")
    volume = torch.full(x.shape, 120.0)
    for place, size, level in (
        ((0.0, 0.0, -1.0), 0.2, 240.0),
        ((0.45, 0.2, -0.87), 0.14, 20.0),
        ((0.0, -0.75, -0.66), 0.14, 240.0),
    ):
        distance = ((x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2).sqrt()
        volume = torch.where(distance < size, level, volume)
    return ray_caster.Pattern(volume)


def panel(
    axis: Axes, title: str, step: tuple[float, float], turn: tuple[float, ...], arrow: tuple[float, float] | None
) -> None:
    """The ball after the motion, with the circle and the motion of its front as an arrow."""
    after = So3.exp(torch.tensor([turn])).matrix()
    image = ray_caster.render(marks(), CENTRE + torch.tensor([step]), RADIUS, after, 200.0, shape=(SIZE, SIZE))[0]
    axis.imshow(image.numpy(), cmap="gray", vmin=0, vmax=255)
    angle = np.linspace(0, 2 * np.pi, 200)
    x, y = CENTRE[0].tolist()
    axis.plot(x + RADIUS * np.cos(angle), y + RADIUS * np.sin(angle), ":", color=BLUE, lw=1)
    if arrow is None:
        bend = np.linspace(-np.pi / 2, -np.pi / 2 + 0.9, 40)
        reach = 0.8 * RADIUS
        axis.plot(x + reach * np.cos(bend), y + reach * np.sin(bend), color=VERMILION, lw=2)
        end = (x + reach * np.cos(bend[-1]), y + reach * np.sin(bend[-1]))
        axis.annotate(
            "",
            end,
            (x + reach * np.cos(bend[-4]), y + reach * np.sin(bend[-4])),
            arrowprops={"arrowstyle": "-|>", "color": VERMILION, "lw": 2},
        )
    else:
        axis.annotate(
            "", (x + arrow[0], y + arrow[1]), (x, y), arrowprops={"arrowstyle": "-|>", "color": VERMILION, "lw": 2}
        )
    axis.set_title(title, fontsize=9)
    axis.set_xticks([])
    axis.set_yticks([])


def main() -> None:
    """Draw the five panels, and the axes themselves, side by side."""
    with saved_figure(DOCS / "axes.png", (12.0, 2.4), dpi=110) as figure:
        axes = figure.subplots(1, 6)
        frame = axes[0]
        image = ray_caster.render(marks(), CENTRE, RADIUS, torch.eye(3)[None], 200.0, shape=(SIZE, SIZE))[0]
        frame.imshow(image.numpy(), cmap="gray", vmin=0, vmax=255)
        for end, name in (((45.0, 8.0), "x"), ((8.0, 45.0), "y")):
            frame.annotate("", end, (8, 8), arrowprops={"arrowstyle": "-|>", "color": BLUE, "lw": 2})
            frame.text(end[0] + 2, end[1] + 4, name, color=BLUE, fontsize=11)
        frame.plot(8, 8, "o", color=BLUE, ms=8, mfc="white")
        frame.plot(8, 8, "x", color=BLUE, ms=6)
        frame.set_title("axes; z into the picture", fontsize=9)
        frame.set_xticks([])
        frame.set_yticks([])
        for axis, (title, step, turn, arrow) in zip(axes[1:], PANELS, strict=True):
            panel(axis, title, step, turn, arrow)


if __name__ == "__main__":
    main()
