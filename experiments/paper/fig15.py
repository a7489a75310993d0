"""Figure 15, the curved path of an oblique impact and a partly hidden ball: ``python -m experiments.paper.fig15``.

Claim: the path may be curved, and the method is robust if the target hides a part of the ball.

Paper: the path, with the circle at 0.65 ms in contact; no numbers.

Here: the impact of `fig14`, whose plate hides a part of the ball's image. The tracker does not know the plate.
"""

from __future__ import annotations

import numpy as np
from matplotlib.patches import Circle

from experiments.experiment import FIGURES, VERMILION, Array, Row, claims, saved_figure
from experiments.paper.fig14 import Oblique, compute

#: Time in the recording at which the paper shows the circle, s.
SHOWN_S = 0.65e-3
#: Least hidden share of a partly hidden ball.
HIDDEN = 0.02
#: Largest error of a position on the ball, as a share of the radius.
ON_BALL = 0.02


def hidden_share(depth: Array) -> Array:
    """Share (n,) of a disc of radius 1 beyond a straight edge, which it passes by ``depth`` (n,), from 0 to 2."""
    inside = np.clip(depth, 0.0, 2.0)
    away = 1 - inside
    return np.asarray((np.arccos(away) - away * np.sqrt(inside * (2 - inside))) / np.pi)


def hidden(found: Oblique) -> Array:
    """Share (n,) of the ball's image behind the plate, whose face it touches at first touch."""
    normal = np.array(found.setting.normal)
    below = (np.array(found.setting.touch_m) - found.footage.true("x_m", "y_m", "z_m")) @ (
        normal / np.linalg.norm(normal)
    )
    return hidden_share(below / found.footage.shot.setup.ball.radius_m)


def rows(found: Oblique) -> list[Row]:
    """The claims of the figure."""
    radius, true, share = found.footage.circle[2], found.footage.true("x_px", "y_px"), hidden(found)
    error = np.linalg.norm(found.track.position - true, axis=1)
    steps = found.track.increment[:, :2] - found.footage.true("dx_px", "dy_px")[1:]
    covered = (share[1:] > HIDDEN) & (share[:-1] > HIDDEN)
    rms = [float(np.sqrt(np.nanmean(steps[part] ** 2))) for part in (covered, ~covered)]
    chord = true[-1] - true[0]
    away = np.abs((true - true[0]) @ np.array([-chord[1], chord[0]])) / np.linalg.norm(chord)
    measured = bool((found.track.status == "ok").all())
    return [
        Row(
            "fig15",
            "The path may be curved.",
            "seen in the figure",
            f"up to {away.max():.0f} px off a straight line; positions off by {np.nanmax(error):.2f} px at most, "
            f"{(found.track.status == 'ok').sum()} of {len(error)} frames measured",
            measured and bool(np.nanmax(error) < ON_BALL * radius),
        ),
        Row(
            "fig15",
            "The method is robust to the target hiding a part of the ball.",
            "seems robust",
            f"up to {100 * share.max():.0f} % hidden; steps off by {rms[0]:.3f} px rms in the {covered.sum()} between "
            f"partly hidden frames, {rms[1]:.3f} px in the others",
            measured and rms[0] < 2 * rms[1],
        ),
    ]


def plot(found: Oblique) -> None:
    """The frames at 0.65 ms and with the largest hidden share, with the path."""
    with saved_figure(FIGURES / "fig15.png", (10, 3.0), dpi=80) as figure:
        share, radius = hidden(found), found.footage.circle[2]
        shown = (round(SHOWN_S * found.footage.shot.frame_rate_hz), int(share.argmax()))
        for axis, frame in zip(figure.subplots(1, 2), shown, strict=True):
            axis.imshow(found.footage.images[frame], cmap="gray", vmin=0, vmax=180)
            x, y = found.track.position.T
            axis.plot(x, y, "+", color=VERMILION, ms=5)
            axis.add_patch(Circle((x[frame], y[frame]), radius, fill=False, color="white", lw=1))
            axis.set_title(
                f"{1e3 * found.footage.shot.times_s[frame]:.2f} ms, {100 * share[frame]:.0f} % of the ball hidden",
                fontsize=9,
            )
            axis.set_ylim(460, 200)
            axis.set_xticks([])
            axis.set_yticks([])


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
