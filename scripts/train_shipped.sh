#!/usr/bin/env bash
# Makes the networks that the package ships: data, trainings, glsim/denoise/shipped/*.onnx. Resumes.
# Usage: scripts/train_shipped.sh FACEXMODEL [FOLDER]
#   FACEXMODEL: ICT-FaceKit's folder. FOLDER: for 3 GB of data and the runs, default build/shipped.
# Two hours on two cores. The results are in docs/model_card.md.
set -euo pipefail
cd "$(dirname "$0")/.."
model=${1:?say where ICT-FaceKit\'s FaceXModel is}
out=${2:-build/shipped}
glsim=${GLSIM:-.venv/bin/glsim}
sets=()

# generate NAME SOURCE PEOPLE FRAMES OPTIONS...: a data set.
generate() {
    local name=$1 source=$2 people=$3 frames=$4
    shift 4
    local root=()
    [ "$source" != ict-facekit ] || root=(--root "$model")
    "$glsim" generate -q -o "$out/$name-$source" --source "$source" "${root[@]}" --subjects "$people" \
        --frames-per-subject "$frames" --depth-unit-mm 0.1 --split 0.94,0.06,0 --set devices=4096 \
        --layers clean,expected,noisy,infrared "$@"
    sets+=(--data "$out/$name-$source")
}

wall=(--set 'scene.wall_mm={ uniform = [900, 2500] }')
# Cameras that nobody built, at four resolutions; half stand before a wall.
seed=100
for size in 320 512 640 1024; do
    for source in procedural ict-facekit people; do
        people=100
        [ "$source" != people ] || people=40
        generate "any-$size" "$source" $people 8 --config "train/data/any_camera_$size.toml" --seed $((++seed))
        generate "any-$size-wall" "$source" $((people / 2)) 16 --config "train/data/any_camera_$size.toml" \
            --seed $((++seed)) "${wall[@]}"
    done
done
# Any Kinect V2.
for source in procedural ict-facekit people; do
    people=160
    [ "$source" != people ] || people=40
    generate kinect "$source" $people 12 --config train/data/randomised.toml --seed $((++seed))
    generate kinect-wall "$source" $((people / 2)) 12 --config train/data/randomised.toml \
        --seed $((++seed)) "${wall[@]}"
done
