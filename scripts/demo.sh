#!/usr/bin/env bash
# Makes a data set of synthetic faces, a contact sheet and a summary in demo/; sets up .venv first.
# `make demo` calls it, and it works without make.
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/setup.sh demo
.venv/bin/glsim generate -o demo/data --subjects 12 --frames-per-subject 30 --set output.crop=160 \
    --set output.layers=clean,noisy,infrared,reason
.venv/bin/glsim preview demo/data -o demo --frames 12
