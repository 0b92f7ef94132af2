"""Networks that denoise depth maps: their inputs, files, safeguards, and the maps made from them.

``network`` runs a network on whole frames. Training and denoising both use this room.
"""
