"""Networks that denoise depth maps: their inputs, files, safeguards, and the maps made from them.

``network`` runs one on whole frames. Training and denoising both build on this.
"""
