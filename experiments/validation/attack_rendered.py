"""The cases of `experiments.validation.attack` that the renderer films: sharp spots, and its own light and optics."""

from __future__ import annotations

from dataclasses import replace

import torchsphere as ts
from experiments.validation.attack_footage import Case, Flight, Recorded, flight, recorded
from experiments.validation.rendered_footage import Look, by_renderer

#: Half the width of the plate in front, radii.
PLATE = 0.8


def seen(look: Look, *, distance_radii: float | None = None, speed: float | None = None) -> Case:
    """Flights as the ``look`` says, seen by a camera at that distance or infinitely far away."""

    def make(seed: int) -> Recorded:
        made = flight(seed, speed=speed)
        if distance_radii is not None:
            camera = ts.Camera(focal_px=made.radius * distance_radii).settled(tuple(made.background.shape))
            made = replace(made, camera=camera)
        return recorded(made, by_renderer(made, look))

    return make


def behind_plate(seed: int) -> Recorded:
    """A grey plate over the middle of the path, which shades the ball behind it."""
    made = flight(seed, speed=4.0)
    return recorded(made, by_renderer(made, Look(plate=_over_the_middle(made))))


def _over_the_middle(made: Flight) -> tuple[float, float]:
    """First and last column of the plate."""
    middle = made.background.shape[1] / 2
    return middle - PLATE * made.radius, middle + PLATE * made.radius


#: Case by its name in the table.
RENDERED: dict[str, Case] = {
    "renderer: nothing": seen(Look()),
    "renderer: fine spots": seen(Look(speckle_px=3.0)),
    "renderer: a lamp": seen(Look(has_lamp=True)),
    "renderer: lacquer and a lamp": seen(Look(has_lamp=True, gloss=0.5)),
    "renderer: camera at 20 radii": seen(Look(), distance_radii=20.0),
    "renderer: exposure blur of 3 px": seen(Look(exposure=0.5), speed=6.0),
    "renderer: plate in front": behind_plate,
}
