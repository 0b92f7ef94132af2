"""``glsim info``: print versions and the OpenGL back ends that work."""

from __future__ import annotations

from rich.table import Table

from glsim.cli.common import JsonOption, make_console, print_json, print_table
from glsim.core.errors import ConfigError, DeviceError


def info(as_json: JsonOption = False) -> None:
    """Print versions and the OpenGL back ends with their drivers.

    A missing back end is listed with the packages to install.
    """
    from importlib.metadata import version

    import glsim.gl.context as gl

    chosen = gl.chosen_backend()
    table = Table("backend", "state", "renderer", "version", "vendor", box=None)
    working = []
    found: list[dict[str, str]] = []
    for backend in gl.BACKENDS:
        try:
            context = gl.open_context(backend)
        except DeviceError as error:
            table.add_row(backend, "missing", f"install: {gl.INSTALL_HINT[backend]}", str(error))
            found.append({"backend": backend, "state": "missing", "reason": str(error)})
            continue
        driver = gl.describe(context)
        context.release()
        working.append(backend)
        state = "used" if backend == (chosen or working[0]) else "works"
        table.add_row(backend, state, driver["renderer"], driver["version"], driver["vendor"])
        found.append({"backend": backend, "state": state, **driver})
    out = make_console()
    packages = ("glsim", "moderngl", "numpy", "opencv-contrib-python-headless", "trimesh")
    versions = {package: version(package) for package in packages}
    devices = [str(device) for device in gl.egl_devices()]
    if as_json:
        print_json({"versions": versions, "backends": found, "egl_devices": devices})
    else:
        out.print(", ".join(f"{name} {n}" for name, n in versions.items()), soft_wrap=True)
        print_table(table)
        for number, device in enumerate(devices):
            out.print(f"EGL device {number}: {device}", soft_wrap=True)
    if not working:
        raise DeviceError("no OpenGL back end works: install one of the packages above")
    if chosen is not None and chosen not in working:
        raise ConfigError(f"GLSIM_BACKEND={chosen} does not work here; these do: {working}")
