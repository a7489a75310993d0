"""How the state of all degrees of freedom moves on from frame to frame: matrix, offset and covariance of each step.

From frame to frame ``phi' = Ad phi + J (v dt + a dt^2 / 2 + j dt^3 / 6) - s``, with the reference's step ``s``, its
rotation ``Ad`` and left Jacobian ``J``. What the turning of the axis within a step adds, ``dt^3/12 a x w``, is below
1e-6 rad for a ball that is spun up to 3 deg per frame in ten frames.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.contact import Contact
from torchsphere.poses import FREEDOMS, Poses
from torchsphere.process import ABSENT, STATES, STEADY, Transitions

#: Numbers in the state of a flight and of a contact.
FLIGHT, SIZE = STEADY * FREEDOMS, STATES * FREEDOMS


class Moves:
    """Matrix, offset and covariance of the transition from frame i to the next, of all n c rows.

    Where none of the rows is in contact the states have no jerk and snap: most frames cost a fifth.
    """

    def __init__(self, poses: Poses, contact: Contact, moves: Transitions, c: int) -> None:
        self._step = (poses.step / poses.unit[:, None]).repeat_interleave(c, 0)
        self._turn, self._jacobian = (v.repeat_interleave(c, 0) for v in _turning(poses.step[..., 2:]))
        self._moves, self._c = moves, c
        intensity = (contact.noise**2 * contact.contact).flatten(0, 1)
        smooth = contact.smooth.flatten(0, 1)
        self._rough = torch.where(smooth, 0.0, intensity)
        self._smooth = torch.where(smooth, intensity, ABSENT)
        self._flight = (contact.noise**2 * contact.flight).flatten(0, 1)
        self._drift = (poses.drift / poses.unit[:, None] ** 2).repeat_interleave(c, 0)
        #: Kinds of state that each frame has: its own if the transition to it touches.
        self._kinds = [STEADY, *(STATES if touching else STEADY for touching in moves.touching)]

    def at(self, i: int) -> tuple[Tensor, Tensor, Tensor]:
        """Matrix (b, s', s), offset (b, s'), covariance (b, s', s'), with s and s' the sizes of both states."""
        before, after = self._kinds[i : i + 2]
        block = self._moves.matrix[:, :, i, :after, :before].flatten(0, 1)
        flight = self._moves.flight[:, :, i, :after, :after].expand(-1, self._c, -1, -1).flatten(0, 1)
        whole, added = _spread_out(block, torch.ones_like(self._flight)), _spread_out(flight, self._flight)
        if after > STEADY:
            for kind, intensity in ((self._moves.rough, self._rough), (self._moves.smooth, self._smooth)):
                added = added + _spread_out(kind[:, :, i].flatten(0, 1), intensity)
        # The rotation's step is that of a vector, seen from the tangent space at its end.
        along = torch.eye(after * FREEDOMS, dtype=whole.dtype, device=whole.device).repeat(len(whole), 1, 1)
        along[:, 2:FREEDOMS, 2:FREEDOMS] = self._jacobian[:, i]
        whole, added = along @ whole, along @ added @ along.mT
        whole[:, 2:FREEDOMS, 2:FREEDOMS] = self._turn[:, i]
        added[:, :FREEDOMS, :FREEDOMS] += torch.diag_embed(self._drift[:, i])
        later = torch.arange(FLIGHT, after * FREEDOMS)
        added[:, later, later] += self._moves.idle[:, :, i].flatten(0, 1)[:, None].to(whole)
        offset = torch.zeros(len(whole), after * FREEDOMS, dtype=whole.dtype, device=whole.device)
        offset[:, :FREEDOMS] = -self._step[:, i]
        return whole, offset, added


def _spread_out(block: Tensor, factor: Tensor) -> Tensor:
    """Kronecker product (b, 5 r, 5 s) of (b, r, s) and the diagonal (b, 5)."""
    product = block[:, :, None, :, None] * torch.diag_embed(factor)[:, None, :, None, :]
    return product.flatten(3, 4).flatten(1, 2)


def _turning(step: Tensor) -> tuple[Tensor, Tensor]:
    """Rotation and left Jacobian (..., 3, 3) of rotation vectors (..., 3), rad."""
    x, y, z = step.unbind(-1)
    none = torch.zeros_like(x)
    cross = torch.stack((none, -z, y, z, none, -x, -y, x, none), -1).unflatten(-1, (3, 3))
    angle = step.norm(dim=-1)[..., None, None]
    one = torch.eye(3, dtype=step.dtype, device=step.device)
    half = torch.sinc(angle / (2 * torch.pi)) ** 2 / 2
    # (t - sin t) / t^3, which loses its digits at small angles; there the series' next term is below 1e-9.
    third = torch.where(angle > 1e-2, (angle - angle.sin()) / angle.clamp_min(1e-2) ** 3, (1 - angle**2 / 20) / 6)
    return torch.linalg.matrix_exp(cross), one + half * cross + third * cross @ cross
