"""Measures of depth frames, real or simulated: noise, pattern, light, edges, lost pixels.

``frame`` holds frames in memory, ``static`` says which of them show one view. ``depth_noise``,
``pattern``, ``light``, ``silhouettes``, ``validity`` and ``boards`` measure one fact of such frames
each; ``disparity``, ``disparity_steps`` and ``lattice`` measure cameras that match pixels or dots;
``stacks`` measures arrays of many frames of one scene, ``depth_errors`` pairs with a clean map.
``correlation``, ``runs`` and ``surfaces`` serve all of them.
"""
