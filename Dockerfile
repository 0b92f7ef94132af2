# docker build -t glsim .
# docker run --rm -u "$(id -u):$(id -g)" -v "$PWD:/data" glsim generate -o data --subjects 10
# The same base for ever: FROM debian:12-slim@sha256:..., as printed by
# docker buildx imagetools inspect debian:12-slim
# On a GPU, with NVIDIA's container toolkit: docker run --rm --gpus all -v "$PWD:/data" glsim info
FROM debian:12-slim AS wheel
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /build && /build/bin/pip install --no-cache-dir build
COPY . /source
RUN /build/bin/python -m build --wheel --outdir /dist /source

FROM debian:12-slim
# libgl1: moderngl loads libGL.so.1 even with EGL. libosmesa6: the other back end.
RUN apt-get update && apt-get install -y --no-install-recommends \
        python3-venv libegl1 libgl1 libgl1-mesa-dri libosmesa6 && rm -rf /var/lib/apt/lists/*
# The toolkit mounts NVIDIA's libraries only for the capabilities named here (default: compute and
# utility), and libglvnd finds its EGL only by this vendor file, which not every toolkit mounts.
# 10 comes before Mesa's 50; without a GPU the library is absent, and libglvnd takes Mesa.
ENV NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility
RUN mkdir -p /usr/share/glvnd/egl_vendor.d && \
    echo '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}' \
        > /usr/share/glvnd/egl_vendor.d/10_nvidia.json
# EXTRAS: names of pyproject.toml, such as [people] or [eval,train]
ARG EXTRAS=
COPY --from=wheel /dist /dist
COPY constraints.txt /dist/constraints.txt
RUN python3 -m venv /opt/glsim && \
    /opt/glsim/bin/pip install --no-cache-dir -c /dist/constraints.txt "$(ls /dist/*.whl)${EXTRAS}" && rm -r /dist
ENV PATH=/opt/glsim/bin:$PATH
WORKDIR /data
ENTRYPOINT ["glsim"]
CMD ["--help"]
