"""Simulate frames: plan them, build their scenes, render them and add the sensor's noise."""
