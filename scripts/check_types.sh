#!/usr/bin/env bash
# Runs mypy. mypy cannot place a folder into a package, so it reads a tree of links in .mypy_cache, in which
# train, eval and shaders lie inside glsim as they do when installed. Arguments are passed on to mypy.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD tree=$PWD/.mypy_cache/tree
rm -rf "$tree"
mkdir -p "$tree/glsim"
ln -s "$root"/{benchmarks,docs,scripts,tests,pyproject.toml} "$tree"
ln -s "$root"/glsim/* "$root"/{train,eval,shaders} "$tree/glsim"
cd "$tree"
mypy=("$root/.venv/bin/python" -m mypy --cache-dir "$root/.mypy_cache")
[ $# -gt 0 ] || "${mypy[@]}" docs/tutorials/*.py  # scripts, which no list of packages can name
exec "${mypy[@]}" "$@"
