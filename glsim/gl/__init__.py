"""OpenGL without a display: context, shader sources, programs, render targets."""
