"""A thin layer over OpenGL without a display: context, shaders, programs, render targets."""
