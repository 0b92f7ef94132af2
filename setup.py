"""Map the folders train, eval and shaders into the package glsim; pyproject.toml has the rest."""

from setuptools import find_packages, setup

FOLDERS = ("train", "eval", "shaders")
"""Folders of the top level that install inside ``glsim``."""

setup(
    packages=find_packages(include=["glsim*"])
    + [f"glsim.{name}" for name in find_packages(include=[f"{f}*" for f in FOLDERS])],
    package_dir={f"glsim.{folder}": folder for folder in FOLDERS},
)
