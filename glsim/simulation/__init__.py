"""Simulation of frames: plan the tasks, build each scene, render it, and add the sensor's noise."""
