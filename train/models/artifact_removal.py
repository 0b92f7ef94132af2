"""Artefact removal: what the paper calls AR, as the wrapper that it is.

K. H. Jin, M. McCann, E. Froustey, M. Unser, "Deep Convolutional Neural Network for Inverse
Problems in Imaging", IEEE TIP 26(9), 2017: a measurement y = A x is brought back to an image by
the transpose of A, and a network removes the artefacts, phi(A^T y). It is meant for tomography and
magnetic resonance, where A is a projection. In denoising A is the identity, and so is its
transpose: nothing is done, and the network is its backbone, bit for bit and parameter for
parameter. Rows "D7" and "AR D7" of the paper's tables are one network, trained twice.
"""

from __future__ import annotations

from torch import Tensor

from .backbone import Backbone


class ArtifactRemoval(Backbone):
    """phi(A^T y) with A = identity. Shapes, parameters and output are those of the backbone."""

    def __init__(self, backbone: Backbone) -> None:
        super().__init__(backbone.in_channels, backbone.out_channels, backbone.residual)
        self.backbone = backbone

    def adjoint(self, measurement: Tensor) -> Tensor:
        """A^T y, where the operator of a denoising problem is the identity."""
        return measurement

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """The backbone on A^T x."""
        restored: Tensor = self.backbone(self.adjoint(x), valid)
        return restored
