"""A recording or a camera, measured and denoised side by side in a browser: ``glsim live``."""
