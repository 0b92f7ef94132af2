"""Networks that denoise depth maps, for training and denoising; ``network`` runs one on frames."""
