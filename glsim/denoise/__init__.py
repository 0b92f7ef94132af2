"""Denoisers of depth maps: classical filters, trained networks, and functions of the user.

    from glsim import load_denoiser
    depth_mm, valid = load_denoiser("face")(noisy_mm)

noisy_mm: (H, W), float or uint16 millimetres, 0 = no return. ``Denoiser.push`` takes the frames of
a camera one by one; ``Denoiser.estimate`` takes sequences of frames and gives a network's
probability of depth and standard deviation.
"""
