"""State of an adjustment: images, poses, ball and residual profile, and the model linearised there."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from torchsphere.runtime import threads
from torchsphere.sphere_map import forward_model, pixel_weights
from torchsphere.sphere_map.forward_model import Linearisation, Pose, Projection, TexturedBall
from torchsphere.sphere_map.pixel_weights import ResidualProfile
from torchsphere.sphere_map.window import Window


@dataclass(frozen=True)
class State:
    """Images, poses and ball at one step of an adjustment."""

    windows: list[Window]  # pixels around the ball in n images, with their visibility
    poses: list[Pose]  # (n,)
    ball: TexturedBall  # radius, map and light, which all images share
    profile: ResidualProfile  # variance of the residual by the distance from the outline

    def project(self) -> list[Projection]:
        """Projection of the ball into each image."""
        ball, project = self.ball, forward_model.project
        return list(threads.parallel_map(lambda window, pose: project(window, pose, ball), self.windows, self.poses))

    def predict(self, projections: list[Projection]) -> list[Tensor]:
        """Grey levels (p,) of the model in each image."""

        def levels(window: Window, pose: Pose, projected: Projection) -> Tensor:
            return forward_model.grey_levels(window, projected, pose, self.ball.coefficients)

        return list(threads.parallel_map(levels, self.windows, self.poses, projections))

    def linearise(self, projections: list[Projection]) -> LinearisedState:
        """The state with the model linearised in each image."""

        def model(window: Window, pose: Pose, projected: Projection) -> Linearisation:
            return forward_model.linearise(window, pose, self.ball, projected)

        return LinearisedState(self, list(threads.parallel_map(model, self.windows, self.poses, projections)))

    def fit_brightness(self, levels: list[Tensor]) -> State:
        """With the gains and offsets that fit best; the model gives the images these ``levels`` (p,)."""
        images = zip(self.windows, self.poses, levels, strict=True)
        return replace(self, poses=[pixel_weights.fit_brightness(w, pose, self.profile, v) for w, pose, v in images])


@dataclass(frozen=True)
class LinearisedState:
    """A state and the model linearised there."""

    state: State
    model: list[Linearisation]  # of each image

    @property
    def levels(self) -> list[Tensor]:
        """Grey levels (p,) of the model in each image."""
        return [model.levels for model in self.model]

    def fit_brightness(self) -> LinearisedState:
        """With the gains and offsets that fit best."""
        state = self.state.fit_brightness(self.levels)
        changes = zip(self.model, self.state.poses, state.poses, strict=True)
        return LinearisedState(state, [model.with_brightness(before, after) for model, before, after in changes])

    def measure_profile(self) -> LinearisedState:
        """With the profile of the present residuals."""
        state = self.state
        profile = pixel_weights.measure_profile(state.windows, state.poses, self.levels, state.ball.radius)
        return LinearisedState(replace(state, profile=profile), self.model)

    def estimate_visibility(self) -> LinearisedState:
        """With the visibility that the present residuals suggest."""
        state, profile = self.state, self.state.profile
        images = zip(state.windows, state.poses, self.levels, strict=True)
        windows = [pixel_weights.estimate_visibility(w, pose, profile, v) for w, pose, v in images]
        return LinearisedState(replace(state, windows=windows), self.model)
