#!/usr/bin/env bash
# Builds the wheel and the sdist, checks both, and uses the wheel as a stranger would: in a fresh
# environment, outside the checkout, without PyTorch. Usage: scripts/check_wheel.sh [--root DIR]
#   --root DIR  installs into a Debian root (12 or 13) instead, made with
#               debootstrap --variant=minbase bookworm DIR (or trixie); needs root and a network
set -euo pipefail
cd "$(dirname "$0")/.."
debian=
if [ "${1:-}" = --root ]; then debian=$(realpath "${2:?say which folder holds the Debian root}"); fi
unset PYTHONPATH
work=$(mktemp -d)
mounts=()
finish() {
    for mount in "${mounts[@]}"; do umount "$mount"; done
    rm -rf "$work"
}
trap finish EXIT
python=${PYTHON:-python3}

echo "== build"
"$python" -m venv "$work/tools"
"$work/tools/bin/pip" install -q --disable-pip-version-check build twine check-wheel-contents
"$work/tools/bin/python" -m build --outdir "$work/dist" . >"$work/build.log" 2>&1 || { tail -20 "$work/build.log" >&2; exit 1; }
"$work/tools/bin/twine" check --strict "$work"/dist/*
"$work/tools/bin/check-wheel-contents" "$work"/dist/*.whl
wheel=$(basename "$work"/dist/*.whl)

# What a stranger does; $1: the command glsim, $2: the Python beside it. Runs in an empty folder.
cat >"$work/dist/use.sh" <<'USE'
set -euo pipefail
glsim=$1 python=$2
"$glsim" --version
"$python" - <<'CODE'
import importlib.util
import pathlib

import glsim

assert importlib.util.find_spec("torch") is None, "PyTorch is installed: this checks life without"
print("imported from", pathlib.Path(glsim.__file__).parent)
pathlib.Path("face.obj").write_text(  # a dome of 24 x 24 vertices, metres
    "".join(
        f"v {x / 100} {y / 100} {0.1 - (x * x + y * y) / 3000}\n"
        for y in range(-12, 12)
        for x in range(-12, 12)
    )
    + "".join(
        f"f {a} {a + 1} {a + 25}\nf {a} {a + 25} {a + 24}\n"
        for y in range(23)
        for a in range(24 * y + 1, 24 * y + 24)
    )
)
CODE
"$glsim" info
"$glsim" render face.obj -o rendered -q
"$glsim" generate -o data --subjects 3 --frames-per-subject 2 --set output.crop=128 --workers 1 -q
"$glsim" verify data -q
noisy=$(find data -name '*_noisy.png' | sort | head -1)
"$glsim" denoise "$noisy" -o denoised.png -q
"$glsim" preview data -o seen --frames 2 -q
find rendered data seen denoised.png -name '*.png' -size +0 | wc -l | sed 's/$/ pictures/'
test -s denoised.png
"$python" - "$noisy" <<'CODE'
import sys

import cv2

noisy, depth = (cv2.imread(name, cv2.IMREAD_UNCHANGED) for name in (sys.argv[1], "denoised.png"))
assert depth.dtype == "uint16" and depth.shape == noisy.shape and (depth > 0).sum() > 500
assert (depth != noisy).any(), "denoise changed nothing"
CODE
USE

if [ -z "$debian" ]; then
    echo "== fresh environment"
    "$python" -m venv "$work/venv"
    "$work/venv/bin/pip" install -q --disable-pip-version-check "$work/dist/$wheel"
    mkdir "$work/empty"
    (cd "$work/empty" && bash "$work/dist/use.sh" "$work/venv/bin/glsim" "$work/venv/bin/python")
else
    echo "== Debian root $debian"
    for folder in proc dev sys; do
        mount --bind "/$folder" "$debian/$folder"
        mounts+=("$debian/$folder")
    done
    cp /etc/resolv.conf "$debian/etc/resolv.conf"
    inside() { chroot "$debian" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive \
        ${PIP_INDEX_URL:+PIP_INDEX_URL="$PIP_INDEX_URL"} ${PIP_CERT:+PIP_CERT=/ca.crt} "$@"; }
    if [ -n "${PIP_CERT:-}" ]; then cp "$PIP_CERT" "$debian/ca.crt"; fi
    # The packages of docs/howto/install.md, and pip; nothing else.
    inside apt-get update -qq
    inside apt-get install -y -qq --no-install-recommends python3-venv libegl1 libgl1 libgl1-mesa-dri >"$work/apt.log" 2>&1 ||
        { tail -20 "$work/apt.log" >&2; exit 1; }
    rm -rf "$debian/check"
    mkdir "$debian/check"
    cp "$work/dist/$wheel" "$work/dist/use.sh" "$debian/check/"
    inside python3 -m venv /check/venv
    inside /check/venv/bin/pip install -q --disable-pip-version-check "/check/$wheel"
    inside sh -c 'mkdir /check/empty && cd /check/empty && bash ../use.sh /check/venv/bin/glsim /check/venv/bin/python'
fi
echo "== all good: $wheel"
