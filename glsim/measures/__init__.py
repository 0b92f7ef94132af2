"""Measures of depth frames, real or simulated: noise, pattern, light, edges, lost pixels.

``measured_frame`` holds what measures use of a frame, ``static`` says which frames show one view.
``depth_noise``, ``pattern``, ``light``, ``silhouettes``, ``validity`` and ``boards`` measure one
fact of frames each; ``disparity``, ``disparity_steps`` and ``lattice`` cameras that match pixels or
dots; ``stacks`` arrays of many frames of one scene, ``depth_errors`` pairs with a clean map.
``correlation``, ``pixel_runs`` and ``quadrics`` serve all of them.
"""
