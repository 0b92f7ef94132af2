"""A thin layer over headless OpenGL: contexts, shaders, programs, render targets."""
