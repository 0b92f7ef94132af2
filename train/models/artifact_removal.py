"""Artefact removal, the paper's AR: a wrapper that does nothing under denoising.

K. H. Jin, M. McCann, E. Froustey, M. Unser, "Deep Convolutional Neural Network for Inverse
Problems in Imaging", IEEE TIP 26(9), 2017: a measurement y = A x is brought back to an image by
the transpose of A, and a network removes the artefacts, phi(A^T y). It is meant for tomography and
magnetic resonance, where A is a projection. In denoising A and its transpose are the identity: the
network equals its backbone, bit for bit and parameter for parameter. Rows "D7" and "AR D7" of the
paper's tables are one network, trained twice.
"""

from __future__ import annotations

from torch import Tensor

from glsim.train.models.backbone import Backbone


class ArtifactRemoval(Backbone):
    """phi(A^T y) with A = identity; shapes, parameters and output equal the backbone's."""

    def __init__(self, backbone: Backbone) -> None:
        super().__init__(backbone.in_channels, backbone.out_channels, backbone.residual)
        self.backbone = backbone
        self.margin_px = backbone.margin_px

    def adjoint(self, measurement: Tensor) -> Tensor:
        """Return A^T y; in denoising A is the identity."""
        return measurement

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """Run the backbone on A^T x."""
        restored: Tensor = self.backbone(self.adjoint(x), valid)
        return restored
