"""A source, two stages, a sensor, a denoiser, a metric, an export and a check for glsim."""
